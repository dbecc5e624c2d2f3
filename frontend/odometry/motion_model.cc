#include "frontend/odometry/motion_model.h"

#include <algorithm>
#include <cmath>

#include "core/base/angle.h"
#include "core/geometry/decompositions.h"

namespace lamina {
namespace {

constexpr double kHeldS = 0.3;
// So that covariances of velocities have inverses, rad^2/s^2 and m^2/s^2.
constexpr double kLeastVariance = 1e-12;
constexpr double kTurnDecayS = 0.5, kWayDecayS = 10.0;
constexpr double kUneven = 0.5;
// Factor on last_gap_s_ with each scan after a short gap.
constexpr double kForgetGap = 0.8;

// Seconds for which the velocity counts in a gap of dt.
double Effective(double dt, double decay_s) {
  if (dt <= kHeldS) return dt;
  return kHeldS + decay_s * (1.0 - std::exp(-(dt - kHeldS) / decay_s));
}

// Standard deviation of the translation or rotation over dt. A velocity that was measured over a
// long gap is known no worse than an unknown one.
double Sigma(double acceleration, double start_speed, bool known, double last_gap_s, double dt) {
  const double measured = 0.5 * acceleration * last_gap_s;
  const double at_most = std::max(start_speed, 0.5 * acceleration * kHeldS);
  const double speed = known ? std::min(measured, at_most) : start_speed;
  return std::hypot(speed * dt, 0.5 * acceleration * dt * dt);
}

}  // namespace

void MotionOptions::Visit(OptionVisitor& v) {
  v.Number("acceleration_sigma_m_s2", &acceleration_sigma_m_s2, 0.01, 1e3);
  v.Number("turn_acceleration_sigma_deg_s2", &turn_acceleration_sigma_deg_s2, 0.1, 1e5);
  v.Number("start_speed_sigma_m_s", &start_speed_sigma_m_s, 0.0, 1e3);
  v.Number("start_turn_sigma_deg_s", &start_turn_sigma_deg_s, 0.0, 1e4);
}

double MotionModel::Gap(StampNs stamp_ns) const {
  return interrupted_ ? 0.0 : std::max(0.0, SecondsBetween(last_stamp_ns_, stamp_ns));
}

bool MotionModel::TellsSweep(StampNs stamp_ns) const {
  const double dt = Gap(stamp_ns);
  return dt > 0.0 && dt <= kMotionOfS;
}

Vector6d MotionModel::Twist(StampNs stamp_ns) const {
  const double dt = Gap(stamp_ns);
  if (interrupted_ || dt <= 0.0) return Vector6d::Zero();
  Vector6d twist = velocity_;
  if (dt > kHeldS) {
    twist.head<3>() *= std::exp(-(dt - kHeldS) / kTurnDecayS);
    twist.tail<3>() *= std::exp(-(dt - kHeldS) / kWayDecayS);
  }
  return twist;
}

PosePrediction MotionModel::Predict(StampNs stamp_ns) const {
  // Gap to assume if the clock does not tell it, as after another recording.
  constexpr double kUnknownGapS = 1.0;
  const double dt = Gap(stamp_ns);
  Vector6d motion = Vector6d::Zero();
  if (!interrupted_) {
    motion << velocity_.head<3>() * Effective(dt, kTurnDecayS),
        velocity_.tail<3>() * Effective(dt, kWayDecayS);
  }
  const bool timed = dt > 0.0 && (stamps_recorded_ || moving_known());
  const double open_s = timed ? dt : std::max(dt, kUnknownGapS);
  const bool known = moving_known();
  const double turn = Sigma(kDegree * options_.turn_acceleration_sigma_deg_s2,
                            kDegree * options_.start_turn_sigma_deg_s, known, last_gap_s_, open_s);
  const double way = Sigma(options_.acceleration_sigma_m_s2, options_.start_speed_sigma_m_s, known,
                           last_gap_s_, open_s);
  // What steps without recorded stamps may differ by.
  const double uneven_turn = stamps_recorded_ ? 0.0 : kUneven * long_step_rad_;
  const double uneven_way = stamps_recorded_ ? 0.0 : kUneven * long_step_m_;
  PosePrediction prediction;
  prediction.T_world_lidar = T_world_last_ * TwistExp(motion);
  prediction.covariance.diagonal()
      << Eigen::Vector3d::Constant(turn * turn + uneven_turn * uneven_turn),
      Eigen::Vector3d::Constant(way * way + uneven_way * uneven_way);
  return prediction;
}

PosePrediction MotionModel::PredictAsAtStart(StampNs stamp_ns) const {
  MotionModel start = *this;
  start.velocity_.setZero();
  start.velocity_known_ = false;
  return start.Predict(stamp_ns);
}

bool MotionModel::uneven() const {
  // Share of a step by which those of one sensor differ as it speeds up and turns.
  constexpr double kEven = 0.25;
  return !stamps_recorded_ && uneven_m_ > kEven * long_step_m_;
}

Matrix6d MotionModel::VelocityChange(double dt) const {
  double turn = kDegree * options_.turn_acceleration_sigma_deg_s2 * dt;
  double way = options_.acceleration_sigma_m_s2 * dt;
  if (!moving_known()) {
    turn = kDegree * options_.start_turn_sigma_deg_s;
    way = options_.start_speed_sigma_m_s;
  }
  if (uneven()) {
    turn = std::hypot(turn, uneven_rad_ / dt);
    way = std::hypot(way, uneven_m_ / dt);
  }
  Vector6d variances;
  variances << Eigen::Vector3d::Constant(turn * turn), Eigen::Vector3d::Constant(way * way);
  return variances.asDiagonal();
}

Matrix6d MotionModel::Drift(StampNs stamp_ns) const {
  const double dt = Gap(stamp_ns);
  return pose_covariance_ + dt * dt * velocity_covariance_;
}

Matrix6d MotionModel::PredictedVelocity(double dt) const {
  return velocity_covariance_ + kLeastVariance * Matrix6d::Identity() + VelocityChange(dt);
}

Matrix6d MotionModel::MeasuredVelocity(double dt, const Matrix6d& covariance) const {
  return (covariance + pose_covariance_) / (dt * dt) + kLeastVariance * Matrix6d::Identity();
}

void MotionModel::UpdateCovariances(double dt, const Matrix6d& covariance) {
  const Matrix6d measured = MeasuredVelocity(dt, covariance);
  velocity_covariance_ =
      moving_known()
          ? Matrix6d(Matrix6d(measured.inverse() + PredictedVelocity(dt).inverse()).inverse())
          : measured;
}

Vector6d MotionModel::WithoutLeap(double dt, const Vector6d& velocity) const {
  constexpr double kLeapSigmas = 5.0;
  const Matrix6d open = velocity_covariance_ + VelocityChange(dt);
  Vector6d result = velocity;
  for (const int part : {0, 3}) {
    const Eigen::Vector3d change = (velocity - velocity_).segment<3>(part);
    const double most = kLeapSigmas * std::sqrt(open.diagonal().segment<3>(part).maxCoeff());
    if (change.norm() > most)
      result.segment<3>(part) = velocity_.segment<3>(part) + most * change.normalized();
  }
  return result;
}

bool MotionModel::IsShort(double dt) const {
  // A velocity over gaps longer than kPeriodS is a mean, which says less.
  constexpr double kShort = 0.3, kPeriodS = 0.1;
  return moving_known() && dt < kShort * std::min(last_gap_s_, kPeriodS);
}

Vector6d MotionModel::Between(double dt, const Matrix6d& covariance,
                              const Vector6d& velocity) const {
  const Matrix6d predicted = PredictedVelocity(dt);
  const Matrix6d gain =
      predicted * Matrix6d(predicted + MeasuredVelocity(dt, covariance)).inverse();
  return velocity_ + gain * (velocity - velocity_);
}

void MotionModel::FollowSteps(StampNs stamp_ns, const SE3& T_world_lidar, bool follows) {
  constexpr double kForget = 0.9;  // of a long step, with each scan
  for (double* step : {&long_step_m_, &long_step_rad_, &uneven_m_, &uneven_rad_}) *step *= kForget;
  if (!follows) return;
  const double step_m = (T_world_lidar.t - T_world_last_.t).norm();
  const double step_rad = RotationAngle(T_world_last_, T_world_lidar);
  long_step_m_ = std::max(long_step_m_, step_m);
  long_step_rad_ = std::max(long_step_rad_, step_rad);
  const SE3 T_led = Predict(stamp_ns).T_world_lidar;
  const bool led = moving_known();
  uneven_m_ = std::max(uneven_m_, led ? (T_world_lidar.t - T_led.t).norm() : kUneven * step_m);
  uneven_rad_ =
      std::max(uneven_rad_, led ? RotationAngle(T_led, T_world_lidar) : kUneven * step_rad);
}

void MotionModel::Accept(StampNs stamp_ns, const SE3& T_world_lidar, bool follows,
                         const Matrix6d& covariance) {
  const double dt = Gap(stamp_ns);
  const bool moved = follows && dt > 0.0;
  const bool short_gap = IsShort(dt);
  Vector6d velocity = Vector6d::Zero();
  if (moved) {
    velocity = TwistTo(T_world_lidar, dt);
    if (moving_known() && stamps_recorded_) velocity = WithoutLeap(dt, velocity);
    if (short_gap) velocity = Between(dt, covariance, velocity);
    UpdateCovariances(dt, covariance);
  } else {
    velocity_covariance_.setZero();
  }
  FollowSteps(stamp_ns, T_world_lidar, moved);
  pose_covariance_ = covariance;
  velocity_known_ = moved;
  velocity_ = velocity;
  if (velocity_known_) last_gap_s_ = short_gap ? kForgetGap * last_gap_s_ : dt;
  last_stamp_ns_ = stamp_ns;
  T_world_last_ = T_world_lidar;
  started_ = true;
  interrupted_ = false;
}

void MotionModel::StartMoving(const Vector6d& velocity) {
  constexpr double kPeriodS = 0.1;
  velocity_ = velocity;
  velocity_known_ = true;
  last_gap_s_ = kPeriodS;
  velocity_covariance_ = 0.25 * VelocityChange(kPeriodS);
}

void MotionModel::StartOver() {
  const bool recorded = stamps_recorded_;
  *this = MotionModel(options_);
  stamps_recorded_ = recorded;
}

void MotionModel::StartAt(const SE3& T_world_lidar) {
  T_world_last_ = T_world_lidar;
  velocity_.setZero();
  velocity_known_ = false;
  started_ = interrupted_ = true;
}

void MotionModel::Archive(StateArchive& a) {
  a(&started_, &interrupted_, &velocity_known_, &last_stamp_ns_, &last_gap_s_, &T_world_last_,
    &velocity_, &long_step_m_, &long_step_rad_, &uneven_m_, &uneven_rad_, &pose_covariance_,
    &velocity_covariance_);
}

}  // namespace lamina
