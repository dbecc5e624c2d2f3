#include "tools/synth/engine/movers.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "tools/synth/engine/random.h"
#include "tools/synth/scenes/objects.h"
#include "tools/synth/scenes/street.h"

namespace lamina::synth {
namespace {

constexpr double kOutOfSight = 140.0;  // metres along the route; beyond every sensor's range

// Along the route at a distance from the sensor's car that changes with time.
class TrafficPath : public UprightPath {
 public:
  struct Lane {
    double offset_m = 0.0;  // left of the middle line
    double height_m = 0.0;  // above the road
    bool oncoming = false;
  };
  TrafficPath(const Terrain& terrain, std::shared_ptr<const Route> route,
              std::shared_ptr<const DriveProfile> drive, const Lane& lane)
      : terrain_(terrain), route_(std::move(route)), drive_(std::move(drive)), lane_(lane) {}

  UprightPose At(double t_s) const override {
    const double sensor = drive_->Arc(t_s);
    const PlanarPose p = route_->Beside(sensor + Ahead(t_s, sensor), lane_.offset_m, 0.0);
    const double z = terrain_.SmoothHeight(p.position.x(), p.position.y()) + lane_.height_m;
    return {{p.position.x(), p.position.y(), z}, p.heading + (lane_.oncoming ? M_PI : 0.0)};
  }

 protected:
  // Metres ahead of the sensor, which is at `sensor` metres of the route.
  virtual double Ahead(double t_s, double sensor) const = 0;

 private:
  Terrain terrain_;
  std::shared_ptr<const Route> route_;
  std::shared_ptr<const DriveProfile> drive_;
  Lane lane_;
};

class FollowingPath final : public TrafficPath {
 public:
  FollowingPath(const Terrain& terrain, std::shared_ptr<const Route> route,
                std::shared_ptr<const DriveProfile> drive, double gap_m, double phase)
      : TrafficPath(terrain, std::move(route), std::move(drive), {-kLaneOffset, 0.0, false}),
        gap_m_(gap_m),
        phase_(phase) {}

 private:
  double Ahead(double t_s, double) const override {
    return gap_m_ + 3.0 * std::sin(2.0 * M_PI * t_s / 40.0 + phase_);
  }
  double gap_m_, phase_;
};

// At a constant speed; from kOutOfSight behind the sensor to as far ahead of it, or back.
class PassingPath final : public TrafficPath {
 public:
  PassingPath(const Terrain& terrain, std::shared_ptr<const Route> route,
              std::shared_ptr<const DriveProfile> drive, const Lane& lane, double start_m,
              double speed)
      : TrafficPath(terrain, std::move(route), std::move(drive), lane),
        start_m_(start_m),
        speed_(lane.oncoming ? -speed : speed) {}

 private:
  double Ahead(double t_s, double sensor) const override {
    const double turns = (start_m_ + speed_ * t_s - sensor) / (2.0 * kOutOfSight);
    return 2.0 * kOutOfSight * (turns - std::floor(turns + 0.5));
  }
  double start_m_, speed_;
};

class CompanyPath final : public UprightPath {
 public:
  CompanyPath(std::shared_ptr<const UprightPath> path, double lead_s, double drop_m)
      : path_(std::move(path)), lead_s_(lead_s), drop_m_(drop_m) {}
  UprightPose At(double t_s) const override {
    const double sway = 0.15 * lead_s_ * std::sin(0.4 * t_s + lead_s_);
    UprightPose pose = path_->At(t_s + lead_s_ + sway);
    pose.position.z() -= drop_m_;
    return pose;
  }

 private:
  std::shared_ptr<const UprightPath> path_;
  double lead_s_, drop_m_;
};

template <typename Add>
std::vector<Primitive> ShapeOf(const Add& add, HashStream* random) {
  std::vector<Primitive> shape;
  add(ShapeBuilder(&shape, Eigen::Vector3f::Zero(), 0.0F), random);
  return shape;
}

}  // namespace

Mover::Mover(std::vector<Primitive> shape, std::shared_ptr<const UprightPath> path)
    : shape_(std::move(shape)), path_(std::move(path)) {
  const Bounds& bounds = shape_.bounds();
  radius_ = bounds.low.abs().max(bounds.high.abs()).matrix().norm();
}

std::optional<SceneHit> Mover::Cast(const UprightPose& pose, const Eigen::Vector3d& origin,
                                    const Eigen::Vector3d& direction, double max_range_m) const {
  const Eigen::Vector3d to_mover = pose.position - origin;
  const double ahead = to_mover.dot(direction);
  if (ahead < -radius_ || ahead > max_range_m + radius_) return std::nullopt;
  if (to_mover.squaredNorm() - ahead * ahead > radius_ * radius_) return std::nullopt;
  const Eigen::AngleAxisd turn(pose.yaw, Eigen::Vector3d::UnitZ());
  const Eigen::Matrix3d R = turn.toRotationMatrix();
  const Ray ray{(R.transpose() * -to_mover).cast<float>(),
                (R.transpose() * direction).cast<float>()};
  auto range = static_cast<float>(max_range_m);
  const Primitive* primitive = shape_.ClosestHit(ray, &range);
  if (!primitive) return std::nullopt;
  const Eigen::Vector3d normal = R * NormalAt(*primitive, ray.At(range)).cast<double>();
  return SceneHit{range, normal.cast<float>(), primitive->material};
}

std::vector<Mover> MakeTraffic(int count, const Terrain& terrain,
                               const std::shared_ptr<const Route>& route,
                               const std::shared_ptr<const DriveProfile>& drive,
                               double cruise_m_per_s, std::int64_t seed) {
  std::vector<Mover> movers;
  for (int k = 0; k < count; ++k) {
    HashStream random(HashOf({seed, 0x30e, k}));
    const double start = random.Uniform(-kOutOfSight, kOutOfSight);
    std::shared_ptr<const UprightPath> path;
    const bool walks = k % 4 == 2;
    if (k % 4 == 0) {
      const double gap = (k % 8 == 0 ? 14.0 : -12.0) * (1 + k / 8);
      path = std::make_shared<FollowingPath>(terrain, route, drive, gap, start);
    } else if (walks) {
      const bool left = random.Chance(0.5);
      const TrafficPath::Lane pavement{left ? kPavementOffset : -kPavementOffset, kCurbHeight,
                                       random.Chance(0.5)};
      path = std::make_shared<PassingPath>(terrain, route, drive, pavement, start,
                                           random.Uniform(0.9, 1.6));
    } else {
      path = std::make_shared<PassingPath>(terrain, route, drive,
                                           TrafficPath::Lane{kLaneOffset, 0.0, true}, start,
                                           cruise_m_per_s * random.Uniform(0.75, 1.1));
    }
    movers.emplace_back(ShapeOf(walks ? AddPedestrian : AddCar, &random), std::move(path));
  }
  return movers;
}

std::vector<Mover> MakeCompany(int count, const std::shared_ptr<const UprightPath>& sensor_path,
                               double sensor_height_m, double speed_m_per_s, std::int64_t seed) {
  std::vector<Mover> movers;
  for (int k = 0; k < count; ++k) {
    HashStream random(HashOf({seed, 0x30f, k}));
    const double distance = (k % 2 == 0 ? 1.0 : -1.0) * (1.8 + 1.1 * (k / 2));
    movers.emplace_back(
        ShapeOf(AddPedestrian, &random),
        std::make_shared<CompanyPath>(sensor_path, distance / speed_m_per_s, sensor_height_m));
  }
  return movers;
}

}  // namespace lamina::synth
