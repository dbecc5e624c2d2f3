// Motion within one scan by a sensor that is shaken: a hand, a trotting robot, a car on cobbles.
//
// Where a sensor turns to and fro within two scans, the mean velocity since the last pose says
// nothing of how it moved during the scan, which may be as fast as at no other time, and a scan
// deskewed by it is distorted by degrees. Here the velocity at the reference instant
// (core/geometry/sweep_motion.h) is free: with the pose T at that instant, the gap t since the last
// one and the mean velocity m between them, the twist and its change during the scan are
//
//     xi = m + t a / 2 + t b,    a,
//
// b being what a steady acceleration a does not explain. Against that motion a cluster measured at
// tau moves by p delta + g_a a + g_b b, where delta is a step of the pose, and
//
//     p = 1 + tau / t,    g_a = tau (tau + t) / 2,    g_b = tau t.
//
// All 18 numbers are found together, by Gauss-Newton steps between which the scan is deskewed anew,
//
//     min  c sum w rho(e_i(T, a, b)) + |a|^2 / sigma_a^2 + |b|^2 / sigma_b^2,
//
// with the residuals and weights of scan_matcher.h, the kernel narrowing from step to step, and
// sigma a few times the acceleration of the motion options, since this is not to be expected. c is
// the share of the information that counts (sweep_acceleration.h). What a motion within half a
// period has beyond its second order stays; a part of the motion found adds to the covariance.
//
// So many numbers fit a scan a little better whatever the sensor did, and worse known ones do harm.
// The motion found stands only if all of this speaks for it:
//   - The clusters lie better on planes than they do the ordinary way (the mean velocity, and the
//     acceleration of sweep_acceleration.h), not by a little, and by the votes of so many blocks of
//     space (block_votes.h) that neither chance nor a thing that moves explains it.
//   - It is none that is expected. By the motion options accelerations are of the standard
//     deviation s, each scan's its own; between two, the acceleration changing evenly by sqrt(2) s,
//     the velocity ends t sqrt(2) s / 6 away from m + t a / 2. With S of both and the covariance C
//     of what was found,
//
//         [a; b]' (S + C)^-1 [a; b]
//
//     is too large for 12 degrees of freedom, or the scan before it was shaken; and
//     |a|^2 / sigma_a^2 + |b|^2 / sigma_b^2 is not.
//   - The sweep is no longer than the gap: a motion of the second order, between two poses, says
//     nothing of times beyond them, and times that are none of this scan's are not to be made up
//     for by a motion.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "core/geometry/point_cluster.h"
#include "core/geometry/se3.h"
#include "core/geometry/sweep_motion.h"
#include "core/map/voxel_map.h"
#include "frontend/matching/scan_matcher.h"
#include "frontend/odometry/motion_model.h"

namespace lamina {

// [a; b] in the frame of the sensor.
using UnsteadyMotion = Eigen::Matrix<double, 12, 1>;

// [a; b] of a motion during a scan at T_world_lidar, with the last pose `gap_s` before it.
UnsteadyMotion UnsteadyPart(const SweepMotion& sweep, const SE3& T_world_last,
                            const SE3& T_world_lidar, double gap_s);

// A scan, and what is known before it. Refers to its parts.
struct ShakenScan {
  const std::vector<TimedCluster>& clusters;
  const VoxelMap& map;
  const PosePrediction& prediction;
  const SE3& T_world_last;  // the last pose,
  double gap_s;             // so long ago
  bool starting;            // nothing is known of the motion yet
  bool goes_on;             // the scan before it was shaken
};

// Stateless; thread-safe while the map is only read. Same bits at any number of threads.
class ShakenSweep {
 public:
  ShakenSweep(const ScanMatcherOptions& matcher, const MotionOptions& motion);

  // Whether a match that was found the ordinary way leaves room for another motion: it fits badly,
  // and the sensor did not move as predicted, or nothing was predicted.
  bool Suspected(const ShakenScan& scan, const MatchResult& match) const;

  // The pose and the motion under which the scan fits best, from several starts, or, if *sweep was
  // found here before, from that. *deskewed is the scan as *match has it. True, and *deskewed,
  // *match, *sweep and *pose_covariance (what is unknown of the motion adds to that of the pose)
  // set, if it is a shake, or, if *sweep was one, fits no worse than *match; otherwise only
  // *deskewed is another.
  bool Find(const ShakenScan& scan, std::vector<PointCluster>* deskewed, MatchResult* match,
            SweepMotion* sweep, Matrix6d* pose_covariance) const;

 private:
  using Matrix12d = Eigen::Matrix<double, 12, 12>;
  struct State {
    SE3 T_world_lidar;
    UnsteadyMotion unsteady = UnsteadyMotion::Zero();
    Matrix12d covariance = Matrix12d::Zero();     // of it
    Matrix6d pose_covariance = Matrix6d::Zero();  // what is unknown of it adds to that of the pose
  };

  SweepMotion MotionOf(const ShakenScan& scan, const State& state) const;
  // One step. False if too little of the map is met.
  bool Step(const ShakenScan& scan, const std::vector<TimedCluster>& clusters, double kernel_sigma,
            std::vector<PointCluster>* deskewed, State* state) const;
  std::vector<SE3> Starts(const ShakenScan& scan, const MatchResult& match) const;
  // The best of the starts, by a part of the clusters.
  State BestOf(const ShakenScan& scan, const std::vector<SE3>& starts) const;
  // Whether a sensor may be shaken like this, by itself or after another scan that was shaken.
  bool Possible(const State& state, bool goes_on) const;
  // Whether the motion found is possible, and larger than the motion options lead to expect.
  bool Unexpected(const State& state) const;
  // Covariance of what the motion has beyond its second order.
  Matrix6d Unmodelled(const ShakenScan& scan, const State& state) const;

  ScanMatcherOptions options_;
  ScanMatcher matcher_;         // with a narrow kernel, for the end of a descent
  UnsteadyMotion information_;  // prior of [a; b] for a shaken sensor
  UnsteadyMotion ordinary_;     // variance of [a; b] for one that is not
};

}  // namespace lamina
