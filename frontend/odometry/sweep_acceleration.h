// Motion within one scan that is not steady: how the sensor accelerated, from the scan itself.
//
// The pose T at the scan's reference instant (core/geometry/sweep_motion.h) and the one a gap t
// before it give the mean velocity between them. With an acceleration a (body, rad/s^2 and m/s^2)
// the sensor was, at tau, away from that steady motion by
//
//     a g(tau),    g(tau) = tau (tau + t) / 2:
//
// nothing at both poses. A cluster measured at tau therefore moves by (1 + tau / t) delta with a
// step delta of the pose, since the mean velocity changes along with it, and by a g(tau) with the
// acceleration. With the residuals e, their rows J and weights w, both are found together,
//
//     | sum w p^2 J'J          sum w p g J'J           | |delta|     | sum w p e J |
//     | sum w p g J'J    c^-1 Sigma^-1 + sum w g^2 J'J | |  a  | = - | sum w g e J |,
//
//     p = 1 + tau / t,
//
// Sigma being the second moment of the accelerations of late, and c the share of the information
// that counts: clusters in one place have errors in common (scan_matcher.h). What is left unknown
// of a, the inverse of its Schur complement, adds H^-1 H_pg P H_pg' H^-1 to the covariance of the
// pose.
#pragma once

#include <vector>

#include "core/geometry/point_cluster.h"
#include "core/geometry/se3.h"
#include "core/geometry/state_archive.h"
#include "core/map/voxel_map.h"
#include "frontend/matching/map_residuals.h"
#include "frontend/matching/scan_matcher.h"
#include "frontend/odometry/motion_model.h"

namespace lamina {

// p and g of a cluster, g the mean over its points.
StepShares SharesOf(const TimedCluster& cluster, double gap_s);

// c: in generated scenes with sensors carried by hand, by car and turning, NEES is near 1 with
// this.
constexpr double kCountingShare = 0.2;

// Transform from the body's directions, rad and m, to the scaled tangent's (degeneracy.h).
Matrix6d BodyToTangent(const SE3& T_world_lidar);

struct SweepAcceleration {
  Vector6d acceleration = Vector6d::Zero();     // of the body twist [w; v], per second
  Matrix6d covariance = Matrix6d::Zero();       // of it
  Vector6d pose_step = Vector6d::Zero();        // tangent: the correction of the pose with it
  Matrix6d pose_covariance = Matrix6d::Zero();  // what is unknown of it adds to that of the pose

  // E[a a'], for RecentAccelerations.
  Matrix6d SecondMoment() const { return acceleration * acceleration.transpose() + covariance; }
};

// deskewed[i] is timed[i] at the reference instant, under steady motion over the `gap_s` up to the
// match's pose. All of zero, if there are too few matches. Pure function; thread-safe.
SweepAcceleration EstimateAcceleration(const ScanMatcherOptions& options,
                                       const std::vector<PointCluster>& deskewed,
                                       const std::vector<TimedCluster>& timed,
                                       const MatchResult& match, const VoxelMap& map, double gap_s,
                                       const Matrix6d& moment);

// Second moment of the accelerations of late: at the start that of the motion options. Each
// estimate has taken its share of what was known before, so estimates and their covariances
// together approach what the sensor does (expectation maximisation). Plain data.
class RecentAccelerations {
 public:
  explicit RecentAccelerations(const MotionOptions& options);

  void Add(const SweepAcceleration& estimate);
  // (rad/s^2)^2 and (m/s^2)^2. A tenth of the options' acceleration may begin at any time.
  Matrix6d Moment() const;

  void Archive(StateArchive& a) { a(&scans_, &recent_); }

 private:
  Matrix6d expected_, recent_;
  double scans_ = 1.0;  // at most kRecent
};

}  // namespace lamina
