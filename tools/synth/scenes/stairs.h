// A stairwell with two flights a storey, and the way up and down in it.
#pragma once

#include <Eigen/Core>
#include <cstdint>

#include "tools/synth/engine/primitive.h"
#include "tools/synth/motion/motion.h"

namespace lamina::synth {

// Inner size of the stairwell, metres.
Eigen::Vector3f StairwellSize();

// Fills the box from the builder's origin to StairwellSize().
void FillStairwell(const ShapeBuilder& at, std::int64_t seed);

// Up all flights, then backwards down again, for ever. `corner` is the stairwell's origin, raised
// by the height at which the sensor is carried.
class StairPath final : public UprightPath {
 public:
  StairPath(const Eigen::Vector3d& corner, double speed_m_per_s)
      : corner_(corner), speed_(speed_m_per_s) {}
  UprightPose At(double t_s) const override;

 private:
  Eigen::Vector3d corner_;
  double speed_;
};

}  // namespace lamina::synth
