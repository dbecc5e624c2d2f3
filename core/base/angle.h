// Angles are radians; options, and what people read, have degrees.
#pragma once

#include <cmath>

namespace lamina {

inline constexpr double kDegree = M_PI / 180.0;

constexpr double Radians(double degrees) { return degrees * M_PI / 180.0; }
constexpr double Degrees(double radians) { return radians * 180.0 / M_PI; }

}  // namespace lamina
