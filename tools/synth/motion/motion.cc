#include "tools/synth/motion/motion.h"

#include <cmath>
#include <utility>

#include "tools/synth/engine/random.h"
#include "tools/synth/scenes/street.h"

namespace lamina::synth {
namespace {

constexpr double kSensorHeight = 1.73;  // above the road
constexpr double kHalfAxleDistance = 1.35;
constexpr double kHalfTrack = 0.8;

SE3 FromEuler(const Eigen::Vector3d& position, double yaw, double pitch, double roll) {
  const Eigen::Quaterniond q = Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) *
                               Eigen::AngleAxisd(pitch, Eigen::Vector3d::UnitY()) *
                               Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitX());
  return SE3(q, position);
}

std::uint64_t ShakeKey(std::int64_t seed, int axis) { return HashOf({seed, 0x5a, axis}); }

}  // namespace

Wobble::Wobble(const std::vector<Wave>& waves, std::uint64_t key) {
  HashStream random(key);
  for (const Wave& wave : waves) {
    terms_.push_back(
        {wave.amplitude, 2.0 * M_PI * wave.frequency_hz, random.Uniform(0.0, 2.0 * M_PI)});
  }
}

double Wobble::At(double t_s) const {
  double sum = 0.0;
  for (const Term& term : terms_) sum += term.amplitude * std::sin(term.rate * t_s + term.phase);
  return sum;
}

CarMotion::CarMotion(const Terrain& terrain, std::shared_ptr<const Route> route,
                     std::shared_ptr<const DriveProfile> drive, std::int64_t seed)
    : terrain_(terrain),
      route_(std::move(route)),
      drive_(std::move(drive)),
      pitch_({{0.003, 0.9}, {0.0015, 1.7}}, ShakeKey(seed, 0)),
      roll_({{0.004, 0.7}, {0.0015, 1.9}}, ShakeKey(seed, 1)),
      heave_({{0.008, 1.1}}, ShakeKey(seed, 2)),
      lane_phase_(2.0 * M_PI * UniformFrom(ShakeKey(seed, 3))) {}

SE3 CarMotion::T_scene_lidar(double t_s) const {
  const double s = drive_->Arc(t_s);
  // Slow weaving within the lane, by the distance driven so that a halted car stands still.
  constexpr double kWeave = 0.15;
  constexpr double kRate = 2.0 * M_PI / 47.0;
  const double phase = kRate * s + lane_phase_;
  const PlanarPose car =
      route_->Beside(s, -kLaneOffset + kWeave * std::sin(phase), kWeave * kRate * std::cos(phase));
  const Eigen::Vector2d ahead(std::cos(car.heading), std::sin(car.heading));
  const Eigen::Vector2d left(-ahead.y(), ahead.x());
  const auto ground = [&](double along, double across) {
    const Eigen::Vector2d p = car.position + along * ahead + across * left;
    return terrain_.SmoothHeight(p.x(), p.y());
  };
  const double front = ground(kHalfAxleDistance, 0.0);
  const double back = ground(-kHalfAxleDistance, 0.0);
  const double port = ground(0.0, kHalfTrack);
  const double starboard = ground(0.0, -kHalfTrack);
  const double speed = drive_->Speed(t_s);
  const double sideways = speed * speed * route_->At(s).curvature;
  const double nod = 0.006 * drive_->Acceleration(t_s);  // nose up when it accelerates
  const double pitch = std::atan2(back - front, 2.0 * kHalfAxleDistance) - nod;
  const double roll = std::atan2(port - starboard, 2.0 * kHalfTrack) + 0.01 * sideways;
  const double height = 0.25 * (front + back + port + starboard) + kSensorHeight;
  const double shake = speed / (speed + 2.0);  // an idle engine does not rock the car
  return FromEuler({car.position.x(), car.position.y(), height + shake * heave_.At(t_s)},
                   car.heading, pitch + shake * pitch_.At(t_s), roll + shake * roll_.At(t_s));
}

HandheldShake ShakeOf(double liveliness) {
  const double k = liveliness;
  HandheldShake o;
  o.x = {{0.03, 0.8}, {0.01, 1.9}};
  o.y = {{0.03, 0.7}, {0.01, 2.1}};
  o.z = {{0.03, 1.1}, {0.01, 2.0}};
  // Rates in rad/s: 2 pi f a.
  o.yaw = {{0.5 * k, 0.31}, {0.08 * k, 0.9}, {0.01 * k, 2.3}};
  o.pitch = {{0.22 * k, 0.23}, {0.05 * k, 1.1}, {0.01 * k, 2.6}};
  o.roll = {{0.12 * k, 0.29}, {0.03 * k, 1.3}, {0.01 * k, 2.2}};
  return o;
}

HandheldMotion::HandheldMotion(std::shared_ptr<const UprightPath> path, const HandheldShake& shake,
                               std::int64_t seed)
    : path_(std::move(path)),
      x_(shake.x, ShakeKey(seed, 10)),
      y_(shake.y, ShakeKey(seed, 11)),
      z_(shake.z, ShakeKey(seed, 12)),
      yaw_(shake.yaw, ShakeKey(seed, 13)),
      pitch_(shake.pitch, ShakeKey(seed, 14)),
      roll_(shake.roll, ShakeKey(seed, 15)) {}

SE3 HandheldMotion::T_scene_lidar(double t_s) const {
  const UprightPose carried = path_->At(t_s);
  const Eigen::Vector3d shake(x_.At(t_s), y_.At(t_s), z_.At(t_s));
  return FromEuler(carried.position + shake, carried.yaw + yaw_.At(t_s), pitch_.At(t_s),
                   roll_.At(t_s));
}

}  // namespace lamina::synth
