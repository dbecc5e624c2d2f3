#include "backend/sliding_window.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "core/parallel.h"

namespace lamina {
namespace {

// Observations in the order in which they are met, chained to planes afterwards.
struct Gathered {
  std::int32_t plane;
  PlaneObservation observation;
};

PointCluster Capped(const PointCluster& cluster, double max_weight) {
  return cluster.count > max_weight ? cluster.Scaled(max_weight / cluster.count) : cluster;
}

}  // namespace

void SlidingWindowOptions::Visit(OptionVisitor& v) {
  v.Integer("frames", &frames, 2, 200);
  v.Number("max_cluster_weight", &max_cluster_weight, 1.0, 1e6);
  v.Number("noise_floor_m", &noise_floor_m, 1e-4, 1.0);
  v.Number("kernel_sigma", &kernel_sigma, 0.1, 1e3);
  v.Integer("max_planes", &max_planes, 10, 10000000);
  v.Number("prior_rotation_deg", &prior_rotation_deg, 1e-4, 180.0);
  v.Number("prior_translation_m", &prior_translation_m, 1e-4, 1e3);
}

SlidingWindow::SlidingWindow(const SlidingWindowOptions& options, VoxelMap* map)
    : options_(options), map_(map) {
  CheckOptions(options, "backend.window");
}

void SlidingWindow::UpdateClusters(const SE3& T, WindowFrame* frame) const {
  const Eigen::Matrix3d R = T.R();
  frame->in_map.resize(frame->deskewed.size());
  ParallelChunks(frame->deskewed.size(), 2048, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      frame->in_map[i] = Capped(frame->deskewed[i], options_.max_cluster_weight).Moved(R, T.t);
    }
  });
}

void SlidingWindow::Push(WindowFrame frame) {
  frame.deskewed = DeskewClusters(frame.measured, frame.twist);
  if (!AnyTimed(frame.measured)) frame.measured.clear();
  UpdateClusters(frame.T_world_lidar, &frame);
  frame.leaves.assign(frame.in_map.size(), VoxelMap::kNoNode);
  for (std::size_t i = 0; i < frame.in_map.size(); ++i) {
    if (!map_->CanHold(frame.in_map[i].mean)) continue;
    frame.leaves[i] = map_->LeafAt(frame.in_map[i].mean);
    map_->Hold(frame.leaves[i]);
    map_->AddWindow(frame.leaves[i], frame.in_map[i], frame.id);
  }
  frames_.push_back(std::move(frame));
}

WindowFrame SlidingWindow::PopOldest() {
  WindowFrame frame = std::move(frames_.front());
  frames_.pop_front();
  for (std::size_t i = 0; i < frame.in_map.size(); ++i) {
    if (frame.leaves[i] == VoxelMap::kNoNode) continue;
    map_->FixWindow(frame.leaves[i], frame.in_map[i], frame.id);
    map_->Release(frame.leaves[i]);
  }
  frame.measured.clear();
  frame.deskewed.clear();
  frame.in_map.clear();
  frame.leaves.clear();
  return frame;
}

void SlidingWindow::Move(std::size_t i, const SE3& T_world_lidar, const Vector6d& twist) {
  WindowFrame& frame = frames_[i];
  frame.T_world_lidar = T_world_lidar;
  if (!frame.measured.empty()) {
    frame.twist = twist;
    frame.deskewed = DeskewClusters(frame.measured, twist);
  }
  const std::vector<PointCluster> before = std::move(frame.in_map);
  UpdateClusters(T_world_lidar, &frame);
  for (std::size_t k = 0; k < before.size(); ++k) {
    if (frame.leaves[k] == VoxelMap::kNoNode) continue;
    map_->ReplaceWindow(frame.leaves[k], before[k], frame.in_map[k]);
  }
}

Vector6d SlidingWindow::CentralTwist(std::size_t i) const {
  Vector6d sum = Vector6d::Zero();
  int terms = 0;
  for (const std::size_t a : {i - 1, i}) {
    if (a + 1 >= frames_.size() || (a == i - 1 && i == 0)) continue;
    const double dt = SecondsBetween(frames_[a].stamp_ns, frames_[a + 1].stamp_ns);
    if (dt <= 0.0 || dt > kMaxTwistGapS) continue;
    sum += TwistLog(frames_[a].T_world_lidar.Inverse() * frames_[a + 1].T_world_lidar) / dt;
    ++terms;
  }
  return terms == 0 ? frames_[i].twist : Vector6d(sum / terms);
}

BundleProblem SlidingWindow::BuildProblem() const {
  BundleProblem problem;
  VoxelIndex plane_of_node(16384);
  std::vector<VoxelMap::NodeId> nodes;
  std::vector<std::int32_t> last;  // for each plane, its last gathered observation
  std::vector<Gathered> gathered;
  const double floor2 = options_.noise_floor_m * options_.noise_floor_m;
  const double kernel2 = options_.kernel_sigma * options_.kernel_sigma;
  for (std::size_t f = 0; f < frames_.size(); ++f) {
    const WindowFrame& frame = frames_[f];
    problem.poses.push_back(frame.T_world_lidar);
    for (std::size_t i = 0; i < frame.leaves.size(); ++i) {
      if (frame.leaves[i] == VoxelMap::kNoNode) continue;
      const VoxelMap::NodeId node = map_->PlaneAbove(frame.leaves[i]);
      if (node == VoxelMap::kNoNode) continue;
      const Surface& surface = map_->surface(node);
      const double distance =
          surface.normal.cast<double>().dot(frame.in_map[i].mean - surface.mean);
      const double e2 =
          distance * distance / (kernel2 * (floor2 + static_cast<double>(surface.variance)));
      const double robust = 1.0 / ((1.0 + e2) * (1.0 + e2));
      const PointCluster cluster =
          Capped(frame.deskewed[i], options_.max_cluster_weight).Scaled(robust);
      const auto fresh = static_cast<std::int32_t>(nodes.size());
      const std::int32_t plane = plane_of_node.FindOrInsert(static_cast<VoxelKey>(node), fresh);
      if (plane == fresh) {
        nodes.push_back(node);
        last.push_back(-1);
      }
      std::int32_t& previous = last[static_cast<std::size_t>(plane)];
      if (previous >= 0 &&
          gathered[static_cast<std::size_t>(previous)].observation.frame == static_cast<int>(f)) {
        gathered[static_cast<std::size_t>(previous)].observation.cluster += cluster;
        continue;
      }
      previous = static_cast<std::int32_t>(gathered.size());
      gathered.push_back({plane, {static_cast<int>(f), cluster}});
    }
  }
  // Counting sort by plane; frames stay ascending within each.
  problem.planes.resize(nodes.size());
  for (const Gathered& g : gathered) ++problem.planes[static_cast<std::size_t>(g.plane)].count;
  std::int32_t first = 0;
  std::vector<std::int32_t> next;
  for (Plane& plane : problem.planes) {
    plane.first = first;
    next.push_back(first);
    first += plane.count;
  }
  problem.observations.resize(gathered.size());
  for (const Gathered& g : gathered) {
    problem.observations[static_cast<std::size_t>(next[static_cast<std::size_t>(g.plane)]++)] =
        g.observation;
  }
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    Plane& plane = problem.planes[i];
    plane.fixed = map_->FixedAggregate(nodes[i]);
    plane.weight = 1.0 / (floor2 + static_cast<double>(map_->surface(nodes[i]).variance));
    if (!plane.fixed.Empty()) problem.hold_first_pose = false;
  }
  // A plane that one frame alone sees binds nothing.
  problem.planes.erase(
      std::remove_if(problem.planes.begin(), problem.planes.end(),
                     [](const Plane& p) { return p.count < 2 && p.fixed.Empty(); }),
      problem.planes.end());
  const auto most = static_cast<std::size_t>(options_.max_planes);
  if (problem.planes.size() > most) {
    std::stable_sort(problem.planes.begin(), problem.planes.end(),
                     [](const Plane& a, const Plane& b) { return a.count > b.count; });
    problem.planes.resize(most);
  }
  Vector6d information;
  information << Eigen::Vector3d::Constant(180.0 / M_PI / options_.prior_rotation_deg),
      Eigen::Vector3d::Constant(1.0 / options_.prior_translation_m);
  for (std::size_t f = 1; f < frames_.size(); ++f) {
    problem.priors.push_back({static_cast<int>(f) - 1, static_cast<int>(f),
                              frames_[f].T_previous_this, Matrix6d(information.asDiagonal())});
  }
  return problem;
}

}  // namespace lamina
