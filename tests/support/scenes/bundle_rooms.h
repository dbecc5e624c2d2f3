// Bundle problems of rooms, floors and chains of frames, for what planes leave open.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "backend/bundle/uncertainty/observability.h"
#include "tests/support/scenes/random_bundles.h"

namespace lamina {

inline const Eigen::Vector3d kX = Eigen::Vector3d::UnitX(), kY = Eigen::Vector3d::UnitY(),
                             kZ = Eigen::Vector3d::UnitZ();

inline std::vector<int> Frames(int first, int end) {
  std::vector<int> frames;
  for (int k = first; k < end; ++k) frames.push_back(k);
  return frames;
}

// Frames and the patches that each of them sees.
class Scene {
 public:
  explicit Scene(unsigned seed) : draws_(seed) {}

  BundleProblem problem;
  int points = 60;  // of a patch in a frame
  double sigma_m = 0.005;
  double weight = 1e4;

  // `count` frames around a place, and their numbers.
  std::vector<int> AddFrames(int count, const Eigen::Vector3d& at) {
    const auto first = static_cast<int>(problem.poses.size());
    for (int k = 0; k < count; ++k) {
      problem.poses.emplace_back(draws_.Offset(0.2, 0.0).q, at + draws_.InCube(0.4));
    }
    return Frames(first, first + count);
  }
  void AddPatch(const Eigen::Vector3d& centre, const Eigen::Vector3d& normal,
                const std::vector<int>& frames) {
    const Patch patch(centre, normal);
    Plane plane;
    plane.first = static_cast<std::int32_t>(problem.observations.size());
    plane.weight = weight;
    for (const int k : frames) {
      const SE3 T_lidar_world = problem.poses[static_cast<std::size_t>(k)].Inverse();
      Points seen;
      for (int i = 0; i < points; ++i) {
        seen.push_back(T_lidar_world * patch.Point(0.5, sigma_m, &draws_));
      }
      problem.observations.push_back({k, ClusterOf(seen)});
      ++plane.count;
    }
    problem.planes.push_back(plane);
  }
  // A wall of `patches` side by side.
  void AddWall(const Eigen::Vector3d& centre, const Eigen::Vector3d& normal,
               const std::vector<int>& frames, int patches = 4) {
    const Eigen::Vector3d along = std::abs(normal.z()) > 0.5 ? kX : normal.cross(kZ).normalized();
    for (int i = 0; i < patches; ++i) {
      AddPatch(centre + (i - 0.5 * (patches - 1)) * along, normal, frames);
    }
  }
  // Four walls that only these frames see.
  void AddRoom(const Eigen::Vector3d& at, const std::vector<int>& frames) {
    for (const double side : {-1.0, 1.0}) {
      AddWall(at + 3.0 * side * kX, kX, frames);
      AddWall(at + 2.5 * side * kY, kY, frames);
    }
  }
  void AddFloor(const Eigen::Vector3d& at, const std::vector<int>& frames) {
    for (int i = -2; i <= 2; ++i) AddWall(at + i * kY - 1.4 * kZ, kZ, frames, 5);
  }
  // Rooms of three frames each, on one floor.
  void AddRooms(int rooms) {
    for (int i = 0; i < rooms; ++i) {
      const Eigen::Vector3d at = 8.0 * i * kX;
      AddRoom(at, AddFrames(3, at));
    }
    AddFloor(4.0 * kX, Frames(0, 3 * rooms));
  }
  Observability Find() const { return FindObservability(problem, ObservabilityOptions()); }

 private:
  Draws draws_;
};

// Frames one after another, each of which sees few of its neighbours' planes: the whole is known
// far worse at its end than the bound, but there is no gap in it.
inline void AddChain(int frames, bool ring, Scene* scene) {
  const auto place = [&](int i) {
    const double angle = 2.0 * M_PI * i / frames;
    const double radius = frames / (2.0 * M_PI);
    return ring ? Eigen::Vector3d(radius * std::cos(angle), radius * std::sin(angle), 0.0)
                : Eigen::Vector3d(i * kX);
  };
  for (int k = 0; k < frames; ++k) scene->AddFrames(1, place(k));
  for (int k = 0; k < frames; ++k) {
    std::vector<int> seen_by;
    for (int i = k - 1; i <= k + 1; ++i) {
      if (ring || (i >= 0 && i < frames)) seen_by.push_back((i + frames) % frames);
    }
    std::sort(seen_by.begin(), seen_by.end());
    scene->AddPatch(place(k) + 2.0 * kY, kY, seen_by);
    scene->AddPatch(place(k) - 2.0 * kY, kY, seen_by);
    scene->AddPatch(place(k) - 1.4 * kZ, kZ, seen_by);
    scene->AddPatch(place(k) + kX + kY, (kX + 0.3 * kY).normalized(), seen_by);
  }
}

}  // namespace lamina
