// How much of the horizon the points of a scan cover.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace lamina {

class HorizontalView {
 public:
  // A point in the LiDAR frame.
  void Add(float x, float y) {
    const double turn = 0.5 + std::atan2(y, x) / (2.0 * M_PI);
    seen_[std::min(kSectors - 1, static_cast<std::size_t>(turn * kAll))] = true;
  }
  // Sectors of 5 degrees with a point in them; of all of them, and together.
  double share() const { return Count() / kAll; }
  double degrees() const { return 360.0 * Count() / kAll; }

 private:
  static constexpr std::size_t kSectors = 72;
  static constexpr double kAll = static_cast<double>(kSectors);
  double Count() const { return static_cast<double>(std::count(seen_.begin(), seen_.end(), true)); }

  std::array<bool, kSectors> seen_{};
};

}  // namespace lamina
