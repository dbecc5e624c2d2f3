#include "backend/pieces/sweep_stamp.h"

#include <cmath>

namespace lamina {

SE3 AtStamp(const SweepMotion& sweep, StampNs middle_ns) {
  if (middle_ns == 0) return SE3();
  // Over longer times the acceleration, which counts by the square, is not known well enough.
  constexpr double kSweepS = 0.5;
  const double tau = SecondsBetween(middle_ns, 0);
  return std::abs(tau) <= kSweepS ? sweep.PoseAt(tau) : SweepMotion(sweep.twist).PoseAt(tau);
}

void MoveToStamp(StampNs middle_ns, OdometryFrame* frame) {
  const SE3 T_middle_stamp = AtStamp(frame->sweep, middle_ns);
  Matrix6d to_stamp = Matrix6d::Identity();
  to_stamp.topLeftCorner<3, 3>() = T_middle_stamp.R().transpose();
  to_stamp.bottomLeftCorner<3, 3>() = -frame->match.T_world_lidar.R() * Hat(T_middle_stamp.t);
  frame->match.covariance = to_stamp * frame->match.covariance * to_stamp.transpose();
  for (SE3* T : {&frame->T_world_lidar, &frame->T_world_predicted, &frame->match.T_world_lidar})
    *T = *T * T_middle_stamp;
  frame->stamp_ns -= middle_ns;
}

}  // namespace lamina
