// A virtual scene for bundle adjustment: poses around planes, and the points they see.
#pragma once

#include <vector>

#include "backend/bundle/cost.h"
#include "backend/bundle/plane_geometry.h"
#include "backend/bundle/problem.h"
#include "core/base/angle.h"
#include "tests/support/scenes/random_scenes.h"

namespace lamina {

struct BundleSceneOptions {
  int poses = 20;
  int planes = 20;
  int points = 40;  // of a plane in a pose
  double seen_share = 1.0;
  double sigma_m = 0.0;
  double start_rotation_deg = 2.0;
  double start_translation_m = 0.1;
  double weight = 1.0;
  double patch_m = 2.0;  // half an edge of a plane
};

struct BundleScene {
  std::vector<SE3> truth;
  std::vector<Patch> patches;
  BundleProblem problem;       // its first pose starts at the truth, and is held there
  std::vector<Points> points;  // of each observation, LiDAR frame
};

inline BundleScene MakeBundleScene(const BundleSceneOptions& options, Draws* draws) {
  BundleScene scene;
  for (int k = 0; k < options.poses; ++k) {
    scene.truth.push_back(k == 0 ? SE3() : SE3(draws->Pose(1.0).q, draws->InCube(2.0)));
    const SE3& T = scene.truth.back();
    const SE3 off =
        k == 0 ? SE3()
               : draws->Offset(options.start_rotation_deg * kDegree, options.start_translation_m);
    scene.problem.poses.emplace_back(T.q * off.q, T.t + off.t);
  }
  for (int i = 0; i < options.planes; ++i) {
    scene.patches.emplace_back(draws->InCube(5.0), draws->Direction());
    Plane plane;
    plane.first = static_cast<std::int32_t>(scene.points.size());
    plane.weight = options.weight;
    for (int k = 0; k < options.poses; ++k) {
      if (draws->Uniform(0.0, 1.0) > options.seen_share) continue;
      const SE3 T_lidar_world = scene.truth[static_cast<std::size_t>(k)].Inverse();
      Points seen;
      for (int p = 0; p < options.points; ++p) {
        seen.push_back(T_lidar_world *
                       scene.patches.back().Point(options.patch_m, options.sigma_m, draws));
      }
      scene.problem.observations.push_back({k, ClusterOf(seen)});
      scene.points.push_back(std::move(seen));
      ++plane.count;
    }
    scene.problem.planes.push_back(plane);
  }
  return scene;
}

// Normal equations of a cost, multiplied out; returns the cost.
inline double LineariseDense(const BundleProblem& problem, const std::vector<SE3>& poses,
                             BundleCost* cost, Eigen::VectorXd* g, Eigen::MatrixXd* H) {
  ReducedSystem system;
  cost->Linearise(poses, &system);
  system.Assemble(problem, BundleIndex(problem), H);
  *g = system.gradient;
  return system.cost;
}

// The poses with one component of one tangent vector moved.
inline std::vector<SE3> Retracted(const std::vector<SE3>& poses, Eigen::Index component,
                                  double step) {
  std::vector<SE3> moved = poses;
  Vector6d delta = Vector6d::Zero();
  delta(component % 6) = step;
  const auto k = static_cast<std::size_t>(component / 6);
  moved[k] = Retract(poses[k], delta);
  return moved;
}

// The points that take part in a plane, in the world, and the frame of each.
struct PlanePoints {
  Points world;
  std::vector<int> frame;
};

inline PlanePoints PointsOfPlane(const BundleScene& scene, const Plane& plane,
                                 const std::vector<SE3>& poses) {
  PlanePoints result;
  for (int i = plane.first; i < plane.first + plane.count; ++i) {
    const int frame = scene.problem.observations[static_cast<std::size_t>(i)].frame;
    for (const Eigen::Vector3d& p : scene.points[static_cast<std::size_t>(i)]) {
      result.world.push_back(poses[static_cast<std::size_t>(frame)] * p);
      result.frame.push_back(frame);
    }
  }
  return result;
}

// Takes the first `frames` poses out of the problem, as marginalisation does: their clusters, where
// `poses` puts them, become fixed ones. Poses of the result start at `poses`.
inline BundleProblem Marginalised(const BundleProblem& full, int frames,
                                  const std::vector<SE3>& poses) {
  BundleProblem rest;
  rest.poses.assign(poses.begin() + frames, poses.end());
  rest.hold_first_pose = false;
  for (const Plane& plane : full.planes) {
    Plane left = plane;
    left.first = static_cast<std::int32_t>(rest.observations.size());
    left.count = 0;
    for (int i = plane.first; i < plane.first + plane.count; ++i) {
      const PlaneObservation& o = full.observations[static_cast<std::size_t>(i)];
      if (o.frame < frames) {
        left.fixed += o.cluster.Moved(poses[static_cast<std::size_t>(o.frame)]);
      } else {
        rest.observations.push_back({o.frame - frames, o.cluster});
        ++left.count;
      }
    }
    rest.planes.push_back(left);
  }
  return rest;
}

}  // namespace lamina
