#include "frontend/odometry.h"

#include <algorithm>

namespace lamina {

void OdometryOptions::Visit(OptionVisitor& v) {
  v.Integer("deskew_passes", &deskew_passes, 0, 10);
  v.Number("max_prediction_gap_s", &max_prediction_gap_s, 0.0, 1e6);
  v.Group("matcher", &matcher);
}

Odometry::Odometry(const OdometryOptions& options) : options_(options), matcher_(options.matcher) {
  CheckOptions(options, "frontend");
}

OdometryFrame Odometry::Register(StampNs stamp_ns, const std::vector<TimedCluster>& clusters,
                                 const VoxelMap& map) const {
  OdometryFrame frame;
  frame.stamp_ns = stamp_ns;
  if (accepted_ == 0) return frame;
  const double dt = SecondsBetween(last_stamp_ns_, stamp_ns);
  const bool known = dt <= options_.max_prediction_gap_s;
  frame.twist = known ? velocity_ : Vector6d::Zero();
  frame.T_world_predicted = T_world_last_ * TwistExp(frame.twist * dt);
  frame.match = matcher_.Match(DeskewClusters(clusters, frame.twist), frame.T_world_predicted, map);
  const bool timed = std::any_of(clusters.begin(), clusters.end(), [](const TimedCluster& c) {
    return c.time_scatter > 0.0 || c.mean_time_s != 0.0;
  });
  for (int pass = 0; timed && known && pass < options_.deskew_passes; ++pass) {
    frame.twist = TwistLog(T_world_last_.Inverse() * frame.match.T_world_lidar) / dt;
    frame.match =
        matcher_.Match(DeskewClusters(clusters, frame.twist), frame.match.T_world_lidar, map);
  }
  frame.T_world_lidar = frame.match.T_world_lidar;
  return frame;
}

void Odometry::Accept(StampNs stamp_ns, const SE3& T_world_lidar) {
  const double dt = SecondsBetween(last_stamp_ns_, stamp_ns);
  velocity_.setZero();
  if (accepted_ > 0 && dt > 0.0) velocity_ = TwistLog(T_world_last_.Inverse() * T_world_lidar) / dt;
  last_stamp_ns_ = stamp_ns;
  T_world_last_ = T_world_lidar;
  ++accepted_;
}

void Odometry::Correct(const SE3& correction) { T_world_last_ = correction * T_world_last_; }

}  // namespace lamina
