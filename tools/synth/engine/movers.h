// Things that move while the sensor does: cars in traffic, people on foot.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "tools/synth/engine/bvh.h"
#include "tools/synth/engine/scene.h"
#include "tools/synth/motion/motion.h"

namespace lamina::synth {

// An upright solid on a path. Immutable: thread-safe.
class Mover {
 public:
  Mover(std::vector<Primitive> shape, std::shared_ptr<const UprightPath> path);

  UprightPose At(double t_s) const { return path_->At(t_s); }
  // Of a ball about the pose's position that holds the shape.
  double radius() const { return radius_; }

  // First hit nearer than max_range_m of a ray in the scene frame, for the mover at `pose`.
  std::optional<SceneHit> Cast(const UprightPose& pose, const Eigen::Vector3d& origin,
                               const Eigen::Vector3d& direction, double max_range_m) const;

 private:
  PrimitiveTree shape_;
  std::shared_ptr<const UprightPath> path_;
  double radius_ = 0.0;
};

// `count` movers on and beside a street: cars that keep a changing distance ahead of and behind the
// sensor's car in its lane, oncoming cars, and people on the pavements, in turns. Those that the
// sensor leaves behind come again from ahead, out of sight, so the street never empties.
std::vector<Mover> MakeTraffic(int count, const Terrain& terrain,
                               const std::shared_ptr<const Route>& route,
                               const std::shared_ptr<const DriveProfile>& drive,
                               double cruise_m_per_s, std::int64_t seed);

// People who walk on the sensor's own path, ahead of it and behind it.
std::vector<Mover> MakeCompany(int count, const std::shared_ptr<const UprightPath>& sensor_path,
                               double sensor_height_m, double speed_m_per_s, std::int64_t seed);

}  // namespace lamina::synth
