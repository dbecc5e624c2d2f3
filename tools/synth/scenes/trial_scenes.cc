#include "tools/synth/scenes/trial_scenes.h"

#include <cmath>
#include <utility>

#include "tools/synth/engine/random.h"
#include "tools/synth/scenes/indoor.h"
#include "tools/synth/scenes/objects.h"
#include "tools/synth/scenes/trial_street.h"

namespace lamina::synth {
namespace {

constexpr double kSensorOnCar = 1.73;  // above the road, metres

using Path = std::shared_ptr<const UprightPath>;

// Straight along x at a constant speed.
class StraightPath final : public UprightPath {
 public:
  StraightPath(const Eigen::Vector3d& start, double speed_m_per_s)
      : start_(start), speed_m_per_s_(speed_m_per_s) {}
  UprightPose At(double t_s) const override {
    return {start_ + Eigen::Vector3d(speed_m_per_s_ * t_s, 0.0, 0.0), 0.0};
  }

 private:
  Eigen::Vector3d start_;
  double speed_m_per_s_;
};

// Beside something that moves, to and fro about a place that goes with it.
class CompanionPath final : public UprightPath {
 public:
  struct Swing {
    double amplitude_m, rate_rad_per_s, phase;
  };
  CompanionPath(Path base, const Eigen::Vector3d& offset, const Swing& swing)
      : base_(std::move(base)), offset_(offset), swing_(swing) {}
  UprightPose At(double t_s) const override {
    UprightPose pose = base_->At(t_s);
    pose.position += offset_;
    pose.position.x() += swing_.amplitude_m * std::sin(swing_.rate_rad_per_s * t_s + swing_.phase);
    return pose;
  }

 private:
  Path base_;
  Eigen::Vector3d offset_;
  Swing swing_;
};

// The shaft of a lift that goes up: down, and back by a storey when it has gone so far.
class ShaftPath final : public UprightPath {
 public:
  static constexpr double kStoreyM = 3.0;
  ShaftPath(const Eigen::Vector3d& place, double speed_m_per_s)
      : place_(place), speed_m_per_s_(speed_m_per_s) {}
  UprightPose At(double t_s) const override {
    const double storeys = speed_m_per_s_ * t_s / kStoreyM;
    const double down = kStoreyM * (storeys - std::floor(storeys));
    return {place_ - Eigen::Vector3d(0.0, 0.0, down), 0.0};
  }

 private:
  Eigen::Vector3d place_;
  double speed_m_per_s_;
};

// Of a car on an even road.
HandheldShake CarShake() {
  HandheldShake shake;
  shake.y = {{0.1, 0.23}};
  shake.z = {{0.008, 1.1}};
  shake.yaw = {{0.01, 0.23}};
  shake.pitch = {{0.003, 0.9}, {0.0015, 1.7}};
  shake.roll = {{0.004, 0.7}, {0.0015, 1.9}};
  return shake;
}

Mover MakeLorry(const Path& car, HashStream* random) {
  std::vector<Primitive> shape;
  const ShapeBuilder at(&shape, Eigen::Vector3f::Zero(), 0.0F);
  at.Box({-6.5F, -1.25F, 0.9F}, {4.2F, 1.25F, 4.0F}, Material::kMetal);    // trailer
  at.Box({4.6F, -1.25F, 0.5F}, {6.8F, 1.25F, 3.4F}, Material::kCarPaint);  // cabin
  for (const float x : {-5.5F, -4.2F, -2.9F, 5.6F}) {
    at.Tube({x, -1.25F, 0.5F}, {x, 1.25F, 0.5F}, 0.5F, Material::kCloth);
  }
  const CompanionPath::Swing swing{3.0, 0.35, random->Uniform(0.0, 6.28)};
  return {std::move(shape),
          std::make_shared<CompanionPath>(car, Eigen::Vector3d(1.0, 3.6, -kSensorOnCar), swing)};
}

// Three on either side and one ahead.
std::vector<Mover> MakeVans(const Path& car, HashStream* random) {
  std::vector<Mover> movers;
  for (const auto& [x, y] : {std::pair{-8.0, -5.0},
                             {0.0, -5.0},
                             {8.0, -5.0},
                             {-8.0, 5.0},
                             {0.0, 5.0},
                             {8.0, 5.0},
                             {11.0, 0.0}}) {
    std::vector<Primitive> shape;
    const ShapeBuilder at(&shape, Eigen::Vector3f::Zero(), 0.0F);
    at.Box({-2.4F, -0.95F, 0.3F}, {1.4F, 0.95F, 2.1F}, Material::kCarPaint);
    at.Box({1.4F, -0.95F, 0.3F}, {2.4F, 0.95F, 1.2F}, Material::kCarPaint);
    const CompanionPath::Swing swing{1.1, random->Uniform(0.8, 1.6), random->Uniform(0.0, 6.28)};
    movers.emplace_back(std::move(shape), std::make_shared<CompanionPath>(
                                              car, Eigen::Vector3d(x, y, -kSensorOnCar), swing));
  }
  return movers;
}

std::vector<Mover> MakeWalkers(const Path& sensor, HashStream* random) {
  std::vector<Mover> movers;
  for (const double x : {-2.0, 1.2, 2.6, 4.0, 6.0}) {
    std::vector<Primitive> shape;
    AddPedestrian(ShapeBuilder(&shape, Eigen::Vector3f::Zero(), 0.0F), random);
    const CompanionPath::Swing swing{0.2, random->Uniform(0.5, 1.0), random->Uniform(0.0, 6.28)};
    movers.emplace_back(
        std::move(shape),
        std::make_shared<CompanionPath>(sensor, Eigen::Vector3d(x, -1.65, -kSensorInHand), swing));
  }
  return movers;
}

Mover MakeShaft(const Eigen::Vector3d& sensor, double speed_m_per_s) {
  constexpr auto kStorey = static_cast<float>(ShaftPath::kStoreyM);
  std::vector<Primitive> shape;
  const ShapeBuilder at(&shape, Eigen::Vector3f::Zero(), 0.0F);
  at.Box({0.0F, -2.0F, -3.0F * kStorey}, {0.2F, 2.0F, 5.0F * kStorey}, Material::kConcrete);
  for (int i = -3; i < 5; ++i) {
    const float z = kStorey * static_cast<float>(i);
    at.Box({-0.12F, -2.0F, z}, {0.0F, 2.0F, z + 0.3F}, Material::kConcrete);      // a floor
    at.Box({-0.06F, -0.5F, z + 0.3F}, {0.0F, 0.5F, z + 2.3F}, Material::kMetal);  // its door
  }
  const Eigen::Vector3d place(sensor.x() + kLiftFront + 0.35, sensor.y(), 0.0);
  return {std::move(shape), std::make_shared<ShaftPath>(place, speed_m_per_s)};
}

std::unique_ptr<SceneModel> MakeModel(SceneKind kind, std::int64_t seed) {
  switch (kind) {
    case SceneKind::kField:
      return MakeField();
    case SceneKind::kTunnel:
      return MakeTunnel();
    case SceneKind::kForest:
      return MakeForest(seed);
    case SceneKind::kCarPark:
      return MakeCarPark(seed);
    case SceneKind::kPavement:
      return MakePavement(seed);
    case SceneKind::kGlass:
      return MakeGlassCorridor(seed);
    case SceneKind::kLift:
      return MakeLift();
    default:
      return MakeBays(seed);
  }
}

bool IsOnFoot(SceneKind kind) {
  return kind == SceneKind::kForest || kind == SceneKind::kPavement || kind == SceneKind::kGlass ||
         kind == SceneKind::kLift;
}

}  // namespace

bool IsTrialScene(SceneKind kind) { return kind >= SceneKind::kBays; }

double TrialSpeed(SceneKind kind) {
  if (kind == SceneKind::kCarPark) return 3.0;
  if (kind == SceneKind::kLift) return 1.5;
  return IsOnFoot(kind) ? 1.3 : 15.0;
}

TrialScene MakeTrialScene(SceneKind kind, double speed_m_per_s, std::int64_t seed) {
  TrialScene scene;
  scene.model = MakeModel(kind, seed);
  const bool on_foot = IsOnFoot(kind);
  const bool in_lane = kind == SceneKind::kBays || kind == SceneKind::kLorry;
  const Eigen::Vector3d start(2.0, kTrialMiddle - (in_lane ? 1.8 : 0.0),
                              on_foot ? kSensorInHand : kSensorOnCar);
  scene.path =
      std::make_shared<StraightPath>(start, kind == SceneKind::kLift ? 0.0 : speed_m_per_s);
  scene.shake = on_foot ? ShakeOf(0.15) : CarShake();
  HashStream random(HashOf({seed, 0x77}));
  if (kind == SceneKind::kLorry) scene.movers.push_back(MakeLorry(scene.path, &random));
  if (kind == SceneKind::kCarPark) scene.movers = MakeVans(scene.path, &random);
  if (kind == SceneKind::kPavement) scene.movers = MakeWalkers(scene.path, &random);
  if (kind == SceneKind::kLift) scene.movers.push_back(MakeShaft(start, speed_m_per_s));
  return scene;
}

}  // namespace lamina::synth
