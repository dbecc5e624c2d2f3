#include "tools/synth_trial_scenes.h"

#include <utility>

#include "tools/synth_trial_street.h"

namespace lamina::synth {
namespace {

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

// Of a car on an even road; lower than CarMotion's, which feels the ground as well.
HandheldShake CarShake() {
  HandheldShake shake;
  shake.y = {{0.1, 0.23}};
  shake.z = {{0.008, 1.1}};
  shake.yaw = {{0.01, 0.23}};
  shake.pitch = {{0.003, 0.9}, {0.0015, 1.7}};
  shake.roll = {{0.004, 0.7}, {0.0015, 1.9}};
  return shake;
}

}  // namespace

bool IsTrialScene(SceneKind kind) { return kind >= SceneKind::kBays; }

TrialScene MakeTrialScene(SceneKind, double speed_m_per_s, std::int64_t seed) {
  TrialScene scene;
  scene.model = MakeBays(seed);
  scene.path = std::make_shared<StraightPath>(
      Eigen::Vector3d(20.0, 0.5 * kTrialStreetWidth - 1.5, kSensorOnCar), speed_m_per_s);
  scene.shake = CarShake();
  return scene;
}

}  // namespace lamina::synth
