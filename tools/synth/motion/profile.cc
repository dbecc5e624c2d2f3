#include "tools/synth/motion/profile.h"

#include <algorithm>
#include <cmath>

#include "core/base/angle.h"

namespace lamina::synth {
namespace {

constexpr double kStarting = 3.0;          // m/s^2
constexpr double kEmergencyBraking = 8.0;  // m/s^2
constexpr double kRest = 1.5;              // seconds between braking and starting again

// Way made in t seconds from rest until `speed` is reached, and beyond.
double WayFromRest(double t, double speed) {
  const double accelerating = speed / kStarting;
  if (t <= 0.0) return 0.0;
  if (t < accelerating) return 0.5 * kStarting * t * t;
  return speed * (t - 0.5 * accelerating);
}

constexpr StampNs kScanNs = 100000000;

// Way made in t seconds of braking from `speed`, to a stand.
double WayOfBraking(double t, double speed) {
  t = std::min(t, speed / kEmergencyBraking);
  return speed * t - 0.5 * kEmergencyBraking * t * t;
}

}  // namespace

const std::vector<std::string>& ProfileNames() {
  static const std::vector<std::string> names = {"constant", "start", "brake", "gaps",
                                                 "picked",   "spin",  "shake"};
  return names;
}

void ProfileOptions::Visit(OptionVisitor& v) {
  v.EnumChoice("kind", &kind, ProfileNames());
  v.Number("rest_s", &rest_s, 0.0, 600.0);
  v.Number("lean_deg", &lean_deg, -90.0, 90.0);
  v.Number("gap_s", &gap_s, 0.0, 60.0);
  v.Number("turn_deg", &turn_deg, 0.0, 90.0);
  v.Number("shake_deg", &shake_deg, 0.0, 45.0);
  v.Number("shake_m", &shake_m, 0.0, 1.0);
  v.Number("shake_hz", &shake_hz, 0.0, 100.0);
}

Profile::Profile(const ProfileOptions& options, double speed_m_per_s, int frames, std::int64_t seed)
    : options_(options),
      speed_m_per_s_(speed_m_per_s),
      T_carrier_mount_(Eigen::Quaterniond(
                           Eigen::AngleAxisd(options.lean_deg * kDegree, Eigen::Vector3d::UnitY())),
                       Eigen::Vector3d::Zero()) {
  HashStream random(HashOf({seed, 0x9a}));
  cruise_s_ = random.Uniform(3.0, 5.0);
  if (options_.kind == ProfileKind::kShake) {
    constexpr double kOften[] = {1.04, 1.0, 0.96};  // so that no phase stays that of the scans
    for (int axis = 0; axis < 6; ++axis) {
      const Wobble::Wave wave{axis < 3 ? options_.shake_deg * kDegree : options_.shake_m,
                              options_.shake_hz * kOften[axis % 3]};
      shake_.emplace_back(std::vector<Wobble::Wave>{wave}, HashOf({seed, 0x5e, axis}));
    }
  }
  if (options_.kind == ProfileKind::kGaps) MissScans(frames, &random);
  if (options_.kind == ProfileKind::kPicked) PickScans(frames, &random);
}

void Profile::MissScans(int frames, HashStream* random) {
  StampNs missed = 0;
  for (int scan = 20 + random->Index(20); scan < frames; scan += 20 + random->Index(20)) {
    // Whole scans, as a recorder misses them.
    const double length = options_.gap_s > 0.0 ? options_.gap_s : random->Uniform(0.5, 3.0);
    missed += kScanNs * std::llround(10.0 * length);
    gaps_.push_back(static_cast<std::size_t>(scan));
    missed_.push_back(missed);
  }
}

void Profile::PickScans(int frames, HashStream* random) {
  StampNs left_out = 0;
  for (int scan = 1; scan < frames; ++scan) {
    const double way_m = random->Uniform(1.0, 5.0);
    left_out += kScanNs * std::max(0LL, std::llround(10.0 * way_m / speed_m_per_s_) - 1);
    gaps_.push_back(static_cast<std::size_t>(scan));
    missed_.push_back(left_out);
  }
}

double Profile::DriveTime(double t_s) const {
  if (options_.kind == ProfileKind::kStart)
    return WayFromRest(t_s - options_.rest_s, speed_m_per_s_) / speed_m_per_s_;
  if (options_.kind != ProfileKind::kBrake || t_s < 0.0) return t_s;
  // A round: cruising, braking, rest, starting.
  const double braking = speed_m_per_s_ / kEmergencyBraking;
  const double starting = speed_m_per_s_ / kStarting;
  const double rest = options_.rest_s > 0.0 ? options_.rest_s : kRest;
  const double round = cruise_s_ + braking + rest + starting;
  const double moving = cruise_s_ + 0.5 * (braking + starting);  // at full speed as long as this
  const double rounds = std::floor(t_s / round);
  const double t = t_s - rounds * round;
  const double way = speed_m_per_s_ * std::min(t, cruise_s_) +
                     WayOfBraking(std::max(0.0, t - cruise_s_), speed_m_per_s_) +
                     WayFromRest(t - cruise_s_ - braking - rest, speed_m_per_s_);
  return rounds * moving + way / speed_m_per_s_;
}

SE3 Profile::T_carrier_lidar(double t_s) const {
  switch (options_.kind) {
    case ProfileKind::kSpin:
      return Spun(t_s) * T_carrier_mount_;
    case ProfileKind::kShake:
      return Shaken(t_s) * T_carrier_mount_;
    default:
      return T_carrier_mount_;
  }
}

SE3 Profile::Spun(double t_s) const {
  // The rate rises within a second, as the smooth step 3 u^2 - 2 u^3.
  const double u = std::clamp(t_s, 0.0, 1.0);
  const double turned = u * u * u * (1.0 - 0.5 * u) + std::max(0.0, t_s - 1.0);  // seconds
  const double yaw = 10.0 * options_.turn_deg * kDegree * turned;
  const double pitch = 8.0 * kDegree * u * u * (3.0 - 2.0 * u) * std::sin(2.0 * M_PI * 0.6 * t_s);
  return SE3(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) *
                 Eigen::AngleAxisd(pitch, Eigen::Vector3d::UnitY()),
             Eigen::Vector3d::Zero());
}

SE3 Profile::Shaken(double t_s) const {
  const Eigen::Quaterniond q = Eigen::AngleAxisd(shake_[2].At(t_s), Eigen::Vector3d::UnitZ()) *
                               Eigen::AngleAxisd(shake_[1].At(t_s), Eigen::Vector3d::UnitY()) *
                               Eigen::AngleAxisd(shake_[0].At(t_s), Eigen::Vector3d::UnitX());
  return SE3(q, {shake_[3].At(t_s), shake_[4].At(t_s), shake_[5].At(t_s)});
}

StampNs Profile::Missed(std::size_t i) const {
  const auto after = std::upper_bound(gaps_.begin(), gaps_.end(), i) - gaps_.begin();
  return after == 0 ? 0 : missed_[static_cast<std::size_t>(after) - 1];
}

}  // namespace lamina::synth
