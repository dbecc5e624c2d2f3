// Where the next scan is expected, and how well that is known.
//
// The velocity is that of the last motion. Accelerations are not known beforehand: as a random
// constant a over the gap dt they leave, for translation and rotation alike,
//
//     sigma_velocity^2 = (a dt_last / 2)^2,    sigma^2 = (sigma_velocity dt)^2 + (a dt^2 / 2)^2,
//
// with the start speed's standard deviation for sigma_velocity before the first motion. Drift()
// adds the errors of the last two poses: the velocity's covariance V is that of their difference,
// but, since a pose may be little more than a prediction, no worse than the last velocity's,
//
//     V^-1 = ((C + C_last) / dt^2)^-1 + (V_last + (a dt)^2)^-1.
//
// A change of the velocity far beyond V_last + (a dt)^2 is treated as correcting the previous
// pose's error; the velocity is clamped to that bound.
//
// If stamps are made up, scans may be any selection of a drive: the next step is predicted as long
// as the last one, with half of the longest recent step as standard deviation. After a gap of 0.3 s
// the velocity is taken to decay, with a time constant of 0.5 s for turns and of 10 s for
// translations.
#pragma once

#include "core/geometry/scan.h"
#include "core/geometry/se3.h"
#include "core/geometry/state_archive.h"
#include "core/options/options.h"
#include "frontend/matching/scan_matcher.h"

namespace lamina {

struct MotionOptions {
  // Standard deviation of the acceleration, of the way and of the turn.
  double acceleration_sigma_m_s2 = 4.0;
  double turn_acceleration_sigma_deg_s2 = 300.0;
  // Standard deviation of the speed with which a recording starts.
  double start_speed_sigma_m_s = 15.0;
  double start_turn_sigma_deg_s = 50.0;

  void Visit(OptionVisitor& v);
};

// Scans farther apart in time do not follow one another as a sensor delivers them: what lies between
// two of them is more than matching from a prediction can bridge without a known motion.
inline constexpr double kMostFollowingGapS = 0.25;

// Not thread-safe.
class MotionModel {
 public:
  explicit MotionModel(const MotionOptions& options) : options_(options) {}

  PosePrediction Predict(StampNs stamp_ns) const;
  // The same as if the motion so far was not known: all that a start leaves open.
  PosePrediction PredictAsAtStart(StampNs stamp_ns) const;
  // Seconds since the last pose; 0 if the clock was interrupted or runs backwards.
  double Gap(StampNs stamp_ns) const;
  // Body twist, per second, that leads from the last pose to this one in so many seconds.
  Vector6d TwistTo(const SE3& T_world_lidar, double dt_s) const {
    return MeanTwist(T_world_last_, T_world_lidar, dt_s);
  }
  // The motion since a scan longer ago than this says little of the motion during one scan.
  static constexpr double kMotionOfS = 2.0;
  // Whether, at that time, the motion since the last pose tells the motion during a scan.
  bool TellsSweep(StampNs stamp_ns) const;
  // Body twist during a scan at that time, per second; zero where nothing is known of it.
  Vector6d Twist(StampNs stamp_ns) const;

  // Uncertainty of the prediction due to errors of the last poses, on top of its covariance: small,
  // unless the pose was held along a direction for some scans.
  Matrix6d Drift(StampNs stamp_ns) const;

  // Covariance of the change of the velocity over a step of dt (tangent, per second). Uneven steps
  // without recorded stamps add their recent deviations; before a motion is known it is that of a
  // start.
  Matrix6d VelocityChange(double dt) const;

  // An estimated pose with its covariance. `follows`: the motion from the last pose to it gives the
  // velocity.
  void Accept(StampNs stamp_ns, const SE3& T_world_lidar, bool follows,
              const Matrix6d& covariance = Matrix6d::Zero());
  // The last pose moves: T -> correction * T.
  void Correct(const SE3& correction) { T_world_last_ = correction * T_world_last_; }
  // Sets a body velocity, per second, that is known from elsewhere; its covariance stays.
  void Assume(const Vector6d& velocity) { velocity_ = velocity; }
  // The same, where it was measured over so many seconds.
  void Assume(const Vector6d& velocity, double over_s) {
    velocity_ = velocity;
    last_gap_s_ = over_s;
  }
  // Seconds over which the velocity was measured.
  double last_gap_s() const { return last_gap_s_; }
  // Sets the body velocity, per second, at the first pose, with half the standard deviation of its
  // change over a period, as if it had been measured from scan to scan.
  void StartMoving(const Vector6d& velocity);
  // Whether stamps are measured. As long as nothing is said they are.
  void SetStampsRecorded(bool recorded) { stamps_recorded_ = recorded; }
  // Forgets all but whether stamps are measured.
  void StartOver();
  // Makes this pose the last one; the next scan is expected there.
  void StartAt(const SE3& T_world_lidar);

  bool started() const { return started_; }
  bool stamps_recorded() const { return stamps_recorded_; }
  // Whether stamps are made up, and steps differ by more than those of a steady sensor.
  bool uneven() const;
  bool moving_known() const { return velocity_known_ && !interrupted_; }
  const Vector6d& velocity() const { return velocity_; }
  const SE3& T_world_last() const { return T_world_last_; }

  void Archive(StateArchive& a);

 private:
  // Whether a gap is so much shorter than those before that errors of the poses dominate the
  // velocity measured over it.
  bool IsShort(double dt) const;
  // Mean of the last velocity and this one, measured over dt, weighted by their covariances.
  Vector6d Between(double dt, const Matrix6d& covariance, const Vector6d& velocity) const;
  // This velocity, measured over dt, clamped to what may follow from the last one.
  Vector6d WithoutLeap(double dt, const Vector6d& velocity) const;
  // Covariances of the velocity over dt: as the last one predicts it, and as a pose with this
  // covariance and the last pose measure it.
  Matrix6d PredictedVelocity(double dt) const;
  Matrix6d MeasuredVelocity(double dt, const Matrix6d& covariance) const;
  void UpdateCovariances(double dt, const Matrix6d& covariance);
  void FollowSteps(StampNs stamp_ns, const SE3& T_world_lidar, bool follows);

  MotionOptions options_;
  bool started_ = false, interrupted_ = false, velocity_known_ = false;
  StampNs last_stamp_ns_ = 0;
  double last_gap_s_ = 0.0;  // over which the velocity was measured
  bool stamps_recorded_ = true;
  double long_step_m_ = 0.0, long_step_rad_ = 0.0;  // longest recent step
  // Largest recent deviation of a step from constant velocity; before a velocity is known, kUneven
  // of the step.
  double uneven_m_ = 0.0, uneven_rad_ = 0.0;
  SE3 T_world_last_;
  Vector6d velocity_ = Vector6d::Zero();
  // Covariances of the last pose and of the velocity.
  Matrix6d pose_covariance_ = Matrix6d::Zero(), velocity_covariance_ = Matrix6d::Zero();
};

}  // namespace lamina
