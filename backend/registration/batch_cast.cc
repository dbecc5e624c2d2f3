#include "backend/registration/batch_cast.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "backend/bundle/plane_choice.h"
#include "core/base/parallel.h"
#include "core/geometry/cluster_lanes.h"
#include "core/map/voxel_key.h"
#include "frontend/scan/scan_clusters.h"

namespace lamina {
namespace {

// Frames whose clusters are unpacked at once.
constexpr std::size_t kFramesAtOnce = 8;

// Calls prepare(k, slot) for all frames, some at once, and take(k, slot) in their order.
template <typename Prepare, typename Take>
void InOrder(std::size_t frames, const Prepare& prepare, const Take& take) {
  for (std::size_t begin = 0; begin < frames; begin += kFramesAtOnce) {
    const std::size_t count = std::min(kFramesAtOnce, frames - begin);
    ParallelChunks(count, 1, [&](std::size_t first, std::size_t end) {
      for (std::size_t slot = first; slot < end; ++slot) prepare(begin + slot, slot);
    });
    for (std::size_t slot = 0; slot < count; ++slot) take(begin + slot, slot);
  }
}

}  // namespace

BatchCast::BatchCast(const std::vector<BatchFrame>& frames, const std::vector<SE3>& poses,
                     const VoxelMapOptions& map, const SlidingWindowOptions& weights)
    : frames_(frames),
      poses_(poses),
      weights_(weights),
      map_(map),
      sweeps_(frames.size()),
      leaves_(frames.size()) {
  Trajectory trajectory;
  for (std::size_t k = 0; k < frames.size(); ++k) {
    trajectory.push_back({frames[k].stamp_ns, poses[k]});
  }
  for (std::size_t k = 0; k < frames.size(); ++k) {
    MotionThrough(trajectory, k, SlidingWindow::kMaxTwistGapS, &sweeps_[k]);
  }
  std::vector<std::vector<PointCluster>> clusters(kFramesAtOnce);
  InOrder(
      frames.size(),
      [&](std::size_t k, std::size_t slot) {
        std::vector<PointCluster>& all = clusters[slot];
        all = Deskewed(k);
        MoveClusters(all.data(), all.size(), map_.options().max_cluster_weight, poses_[k].R(),
                     poses_[k].t, all.data());
      },
      [&](std::size_t k, std::size_t slot) {
        leaves_[k] = map_.AddFrame(clusters[slot], static_cast<std::int64_t>(k));
      });
  map_.Refresh();
}

std::vector<PointCluster> BatchCast::Deskewed(std::size_t k) const {
  return DeskewClusters(frames_[k].clusters.Unpacked(), sweeps_[k]);
}

BatchCast::PlaneNumbers BatchCast::NumberPlanes(std::vector<Plane>* planes,
                                                std::vector<VoxelMap::NodeId>* nodes) const {
  PlaneNumbers numbers(frames_.size());
  VoxelIndex index(16384);
  std::vector<std::size_t> last_frame;
  // The sides of planes that the clusters of a frame are on: the node, and which side.
  struct SideOfPlane {
    VoxelMap::NodeId node = VoxelMap::kNoNode;
    bool behind = false;
  };
  std::vector<std::vector<SideOfPlane>> sides(kFramesAtOnce);
  const auto find_sides = [&](std::size_t k, std::size_t slot) {
    sides[slot].assign(leaves_[k].size(), {});
    if (leaves_[k].empty()) return;
    const std::vector<PointCluster> clusters = Deskewed(k);
    const Eigen::Matrix3d R = poses_[k].R();
    for (std::size_t i = 0; i < clusters.size(); ++i) {
      const std::size_t ahead = i + VoxelMap::kLeavesAhead;
      if (ahead < clusters.size()) map_.Prefetch(leaves_[k][ahead]);
      if (leaves_[k][i] == VoxelMap::kNoNode) continue;
      const VoxelMap::NodeId node = map_.PlaneAbove(leaves_[k][i]);
      if (node == VoxelMap::kNoNode) continue;
      // From the cluster to the LiDAR.
      const Eigen::Vector3d to_lidar = -(R * clusters[i].mean);
      sides[slot][i] = {node, map_.plane(node).normal.cast<double>().dot(to_lidar) < 0.0};
    }
  };
  InOrder(frames_.size(), find_sides, [&](std::size_t k, std::size_t slot) {
    numbers[k].assign(leaves_[k].size(), kNone);
    for (std::size_t i = 0; i < numbers[k].size(); ++i) {
      const auto [node, behind] = sides[slot][i];
      if (node == VoxelMap::kNoNode) continue;
      const auto fresh = static_cast<std::int32_t>(planes->size());
      const VoxelKey key = 2 * static_cast<VoxelKey>(node) + (behind ? 1 : 0);
      numbers[k][i] = index.FindOrInsert(key, fresh);
      if (numbers[k][i] == fresh) {
        Plane plane;
        plane.first = fresh;
        plane.weight = PlaneWeight(static_cast<double>(map_.plane(node).variance),
                                   map_.options().noise_floor_m);
        planes->push_back(plane);
        nodes->push_back(node);
        last_frame.push_back(frames_.size());
      }
      const auto at = static_cast<std::size_t>(numbers[k][i]);
      if (last_frame[at] == k) continue;
      last_frame[at] = k;
      ++(*planes)[at].count;
    }
  });
  return numbers;
}

BundleProblem BatchCast::Problem(bool with_points) const {
  BundleProblem problem;
  problem.poses = poses_;
  std::vector<VoxelMap::NodeId> nodes;
  const PlaneNumbers numbers = NumberPlanes(&problem.planes, &nodes);
  KeepBinding(weights_.max_planes, &problem.planes);
  DistrustThick(&problem.planes);
  std::vector<std::int32_t> place(nodes.size(), kNone);
  std::int32_t first = 0;
  for (std::size_t p = 0; p < problem.planes.size(); ++p) {
    Plane& plane = problem.planes[p];
    place[static_cast<std::size_t>(plane.first)] = static_cast<std::int32_t>(p);
    plane.first = first;
    first += plane.count;
  }
  problem.observations.resize(static_cast<std::size_t>(first));
  if (with_points) problem.points.resize(problem.observations.size());
  FillIn(numbers, nodes, place, with_points, &problem);
  return problem;
}

void BatchCast::FillIn(const PlaneNumbers& numbers, const std::vector<VoxelMap::NodeId>& nodes,
                       const std::vector<std::int32_t>& place, bool with_points,
                       BundleProblem* problem) const {
  std::vector<std::int32_t> filled(problem->planes.size(), 0);  // observations of each plane
  std::vector<std::vector<PointCluster>> clusters(kFramesAtOnce);
  const auto weigh = [&](std::size_t k, std::size_t slot) {
    clusters[slot] = Deskewed(k);
    const Eigen::Matrix3d R = poses_[k].R();
    for (std::size_t i = 0; i < clusters[slot].size(); ++i) {
      const std::int32_t number = numbers[k][i];
      if (number == kNone) continue;
      PointCluster& c = clusters[slot][i];
      const Surface& plane = map_.plane(nodes[static_cast<std::size_t>(number)]);
      c = c.Capped(map_.options().max_cluster_weight)
              .Scaled(KernelWeight(plane, R * c.mean + poses_[k].t, map_.options().noise_floor_m,
                                   weights_.kernel_sigma));
    }
  };
  InOrder(frames_.size(), weigh, [&](std::size_t k, std::size_t slot) {
    const auto frame = static_cast<int>(k);
    for (std::size_t i = 0; i < clusters[slot].size(); ++i) {
      if (numbers[k][i] == kNone) continue;
      const std::int32_t plane = place[static_cast<std::size_t>(numbers[k][i])];
      if (plane == kNone) continue;
      const std::int32_t begin = problem->planes[static_cast<std::size_t>(plane)].first;
      std::int32_t& count = filled[static_cast<std::size_t>(plane)];
      const auto last = static_cast<std::size_t>(begin + count - 1);
      if (count == 0 || problem->observations[last].frame != frame) ++count;
      const auto o = static_cast<std::size_t>(begin + count - 1);
      problem->observations[o].frame = frame;
      problem->observations[o].cluster += clusters[slot][i];
      if (!with_points) continue;
      AddPoints(k, i, clusters[slot][i].count / frames_[k].clusters[i].points.count,
                &problem->points[o]);
    }
  });
}

double BatchCast::Misfit() const {
  const double most = weights_.kernel_sigma * map_.options().noise_floor_m;
  std::vector<double> sums(kFramesAtOnce);
  double total = 0.0, count = 0.0;
  const auto sum_up = [&](std::size_t k, std::size_t slot) {
    const std::vector<PointCluster> clusters = Deskewed(k);
    const Eigen::Matrix3d R = poses_[k].R();
    sums[slot] = 0.0;
    for (std::size_t i = 0; i < clusters.size(); ++i) {
      double distance = most;
      const VoxelMap::NodeId node =
          leaves_[k][i] == VoxelMap::kNoNode ? VoxelMap::kNoNode : map_.PlaneAbove(leaves_[k][i]);
      if (node != VoxelMap::kNoNode && map_.frames(node) >= 2) {
        const Surface& surface = map_.plane(node);
        const Eigen::Vector3d from = R * clusters[i].mean + poses_[k].t - surface.mean;
        distance = std::min(most, std::abs(surface.normal.cast<double>().dot(from)));
      }
      sums[slot] += distance * distance;
    }
  };
  InOrder(frames_.size(), sum_up, [&](std::size_t k, std::size_t slot) {
    total += sums[slot];
    count += static_cast<double>(leaves_[k].size());
  });
  return count > 0.0 ? std::sqrt(total / count) : 0.0;
}

// Points deskewed as their clusters are, but one by one.
void BatchCast::AddPoints(std::size_t k, std::size_t cluster, double weight,
                          std::vector<WeightedPoint>* points) const {
  for (const TimedPoint& p : frames_[k].points.at(cluster)) {
    const Eigen::Vector3d measured(p.x, p.y, p.z);
    points->push_back(
        {p.time_s == 0.0F ? measured : sweeps_[k].PoseAt(p.time_s) * measured, weight});
  }
}

OtherVoxels::OtherVoxels(const VoxelMapOptions& fitted, const std::vector<SE3>& fitted_poses)
    : map(fitted), poses(fitted_poses) {
  constexpr double kSize = 1.25, kShift = 0.37;  // in root voxels
  map.root_size_m *= kSize;
  map = WithinRange(map);
  for (SE3& T : poses) T.t.array() += kShift * fitted.root_size_m;
}

}  // namespace lamina
