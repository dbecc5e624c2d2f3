#include "frontend/sweep_error.h"

#include <algorithm>

namespace lamina {

void RecentAcceleration::Add(const Vector6d& twist_change, double gap_s) {
  constexpr double kRecent = 8.0;
  const Vector6d acceleration = twist_change / gap_s;
  scans_ = std::min(scans_ + 1.0, kRecent);
  moment_ += (acceleration * acceleration.transpose() - moment_) / scans_;
}

Matrix6d RecentAcceleration::MomentWith(const Vector6d& twist_change, double gap_s) const {
  RecentAcceleration with = *this;
  with.Add(twist_change, gap_s);
  return with.moment_;
}

}  // namespace lamina
