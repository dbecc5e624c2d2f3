#include "backend/mapping/sliding_window.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <utility>

#include "backend/bundle/plane_choice.h"
#include "backend/mapping/observation_weights.h"
#include "core/base/parallel.h"
#include "core/geometry/central_twist.h"
#include "core/geometry/robust_kernel.h"

namespace lamina {
namespace {

// Leaves are fetched so many clusters ahead.
constexpr std::size_t kLeavesAhead = 8;
// In the place of a path: the cluster is in no leaf.
constexpr std::uint64_t kNoLeaf = ~std::uint64_t{0};

// Collects observations by plane while frames are walked in order.
class ProblemBuilder {
 public:
  // `planes`: how many planes of the map there are.
  explicit ProblemBuilder(std::size_t planes) : number_of_(planes, -1) {}

  // Of plane `on` of the map.
  void Add(std::int32_t on, int frame, const PointCluster& cluster) {
    std::int32_t& plane = number_of_[static_cast<std::size_t>(on)];
    if (plane < 0) {
      plane = static_cast<std::int32_t>(map_planes_.size());
      map_planes_.push_back(on);
      last_.push_back(-1);
    }
    std::int32_t& last = last_[static_cast<std::size_t>(plane)];
    if (last >= 0 && gathered_[static_cast<std::size_t>(last)].observation.frame == frame) {
      gathered_[static_cast<std::size_t>(last)].observation.cluster += cluster;
      return;
    }
    last = static_cast<std::int32_t>(gathered_.size());
    gathered_.push_back({plane, {frame, cluster}});
  }

  // Planes in the order in which they were met; the observations of each stand together, frames
  // ascending (a counting sort keeps their order).
  void MoveTo(BundleProblem* problem) const {
    problem->planes.assign(map_planes_.size(), Plane());
    for (const Gathered& g : gathered_) ++problem->planes[static_cast<std::size_t>(g.plane)].count;
    std::vector<std::int32_t> next;
    std::int32_t first = 0;
    for (Plane& plane : problem->planes) {
      plane.first = first;
      next.push_back(first);
      first += plane.count;
    }
    problem->observations.resize(gathered_.size());
    for (const Gathered& g : gathered_) {
      const std::int32_t slot = next[static_cast<std::size_t>(g.plane)]++;
      problem->observations[static_cast<std::size_t>(slot)] = g.observation;
    }
  }

  // The map's plane behind each plane of the problem.
  const std::vector<std::int32_t>& map_planes() const { return map_planes_; }

 private:
  struct Gathered {
    std::int32_t plane;
    PlaneObservation observation;
  };
  std::vector<std::int32_t> number_of_;  // of each plane of the map; -1: none yet
  std::vector<std::int32_t> map_planes_;
  std::vector<std::int32_t> last_;  // for each plane, its last gathered observation
  std::vector<Gathered> gathered_;
};

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
  const double most =
      frame->alone ? std::max<double>(options_.max_cluster_weight, map_->options().min_points)
                   : options_.max_cluster_weight;
  frame->in_map.resize(frame->deskewed.size());
  ParallelChunks(frame->deskewed.size(), 2048, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      frame->in_map[i] = frame->deskewed[i].Capped(most).Moved(R, T.t);
    }
  });
}

void SlidingWindow::Push(WindowFrame frame) {
  frame.deskewed = DeskewClusters(frame.measured, frame.twist);
  if (!AnyTimed(frame.measured)) frame.measured.clear();
  UpdateClusters(frame.T_world_lidar, &frame);
  frame.leaves.assign(frame.in_map.size(), VoxelMap::kNoNode);
  frame.addresses.assign(frame.in_map.size(), {0, kNoLeaf});
  const std::size_t n = frame.in_map.size();
  for (std::size_t i = 0; i < n + kLeavesAhead; ++i) {
    if (i < n && map_->CanHold(frame.in_map[i].mean)) {
      frame.leaves[i] = map_->LeafAt(frame.in_map[i].mean, &frame.addresses[i]);
      map_->Prefetch(frame.leaves[i]);
    }
    if (i < kLeavesAhead || frame.leaves[i - kLeavesAhead] == VoxelMap::kNoNode) continue;
    map_->Hold(frame.leaves[i - kLeavesAhead]);
    map_->AddWindow(frame.leaves[i - kLeavesAhead], frame.in_map[i - kLeavesAhead], frame.id);
  }
  frames_.push_back(std::move(frame));
}

FinalKeyframe SlidingWindow::AsFinal(std::size_t i) const {
  const WindowFrame& frame = frames_[i];
  FinalKeyframe keyframe{frame.id, frame.stamp_ns, frame.T_world_lidar, {}};
  for (std::size_t k = 0; k < frame.in_map.size(); ++k) {
    if (frame.leaves[k] == VoxelMap::kNoNode) continue;
    keyframe.clusters.push_back(frame.in_map[k].Scaled(MarginalWeight(frame, k)));
  }
  return keyframe;
}

void SlidingWindow::PopOldest() {
  const WindowFrame& frame = frames_.front();
  for (std::size_t i = 0; i < frame.in_map.size(); ++i) {
    if (frame.leaves[i] == VoxelMap::kNoNode) continue;
    map_->FixWindow(frame.leaves[i], frame.in_map[i], MarginalWeight(frame, i), frame.id);
    map_->Release(frame.leaves[i]);
  }
  frames_.pop_front();
}

double SlidingWindow::MarginalWeight(const WindowFrame& frame, std::size_t i) const {
  // What stays for good must be able to overrule what was there.
  constexpr double kLeast = 0.005;
  if (!frame.weights.empty() && frame.weights[i] >= 0.0) return std::max(kLeast, frame.weights[i]);
  // Something that stands before a wall makes of both no plane at all; the wall's own past is one.
  const PointCluster fixed = map_->FixedAggregate(frame.leaves[i]);
  const Surface surface = map_->SurfaceOf(fixed, 0);
  if (surface.kind != Surface::Kind::kPlane) return 1.0;
  const double distance = surface.normal.cast<double>().dot(frame.in_map[i].mean - surface.mean);
  const double variance =
      options_.noise_floor_m * options_.noise_floor_m + static_cast<double>(surface.variance);
  return std::max(kLeast,
                  GemanMcClureWeight(distance * distance /
                                     (options_.kernel_sigma * options_.kernel_sigma * variance)));
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
  const std::size_t begin = i == 0 ? 0 : i - 1;
  Trajectory poses;
  for (std::size_t k = begin; k < std::min(i + 2, frames_.size()); ++k) {
    poses.push_back({frames_[k].stamp_ns, frames_[k].T_world_lidar});
  }
  Vector6d twist = frames_[i].twist;
  lamina::CentralTwist(poses, i - begin, kMaxTwistGapS, &twist);
  return twist;
}

BundleProblem SlidingWindow::BuildProblem() {
  BundleProblem problem;
  const double floor2 = options_.noise_floor_m * options_.noise_floor_m;
  const ObservationWeights on_planes(*map_, frames_,
                                     {options_.noise_floor_m, options_.kernel_sigma});
  ProblemBuilder builder(on_planes.nodes().size());
  for (std::size_t f = 0; f < frames_.size(); ++f) {
    WindowFrame& frame = frames_[f];
    frame.weights = on_planes.Weights(f);
    problem.poses.push_back(frame.T_world_lidar);
    if (f > 0) problem.priors.push_back(MotionPrior(f));
    for (std::size_t i = 0; i < frame.leaves.size(); ++i) {
      const std::int32_t plane = on_planes.PlaneOf(f, i);
      if (plane == ObservationWeights::kNone) continue;
      builder.Add(plane, static_cast<int>(f),
                  frame.deskewed[i].Capped(options_.max_cluster_weight).Scaled(frame.weights[i]));
    }
  }
  builder.MoveTo(&problem);
  for (std::size_t i = 0; i < problem.planes.size(); ++i) {
    Plane& plane = problem.planes[i];
    const VoxelMap::NodeId node =
        on_planes.nodes()[static_cast<std::size_t>(builder.map_planes()[i])];
    plane.fixed = map_->FixedAggregate(node);
    plane.weight = 1.0 / (floor2 + static_cast<double>(map_->plane(node).variance));
    if (!plane.fixed.Empty()) problem.hold_first_pose = false;
  }
  if (!frames_.empty()) HoldFirst(&problem);
  KeepBinding(options_.max_planes, &problem.planes);
  DistrustThick(&problem.planes);
  return problem;
}

void SlidingWindow::FindLeaves(WindowFrame* frame) const {
  if (frame->addresses.size() != frame->deskewed.size()) {
    throw InputError("saved window is not whole");
  }
  frame->leaves.assign(frame->addresses.size(), VoxelMap::kNoNode);
  for (std::size_t i = 0; i < frame->leaves.size(); ++i) {
    if (frame->addresses[i].path == kNoLeaf) continue;
    frame->leaves[i] = map_->LeafOf(frame->addresses[i]);
    if (frame->leaves[i] == VoxelMap::kNoNode) {
      throw InputError("saved window and saved map do not match");
    }
    map_->Hold(frame->leaves[i]);
  }
}

void SlidingWindow::Archive(StateArchive& a) {
  frames_.resize(a.Size(frames_.size(), 1));
  for (WindowFrame& frame : frames_) {
    a(&frame.id, &frame.stamp_ns, &frame.T_world_lidar, &frame.twist, &frame.held,
      &frame.held_information, &frame.T_previous_this, &frame.alone, &frame.weights,
      &frame.measured);
    // What follows from other members is made again.
    if (frame.measured.empty()) {
      a(&frame.deskewed);
    } else if (a.reading()) {
      frame.deskewed = DeskewClusters(frame.measured, frame.twist);
    }
    a(&frame.addresses);
    if (!a.reading()) continue;
    UpdateClusters(frame.T_world_lidar, &frame);
    FindLeaves(&frame);
  }
}

void SlidingWindow::HoldFirst(BundleProblem* problem) const {
  const WindowFrame& first = frames_.front();
  for (int k = 0; k < 6 && first.held_information(k) > 0.0; ++k) {
    problem->holds.push_back({0, DividedByArm(Vector6d(first.held.col(k))).normalized()});
  }
}

RelativePrior SlidingWindow::MotionPrior(std::size_t i) const {
  RelativePrior prior;
  prior.a = static_cast<int>(i) - 1;
  prior.b = static_cast<int>(i);
  prior.T_a_b = frames_[i].T_previous_this;
  Vector6d root;
  root << Eigen::Vector3d::Constant(180.0 / M_PI / options_.prior_rotation_deg),
      Eigen::Vector3d::Constant(1.0 / options_.prior_translation_m);
  Matrix6d information = root.cwiseAbs2().asDiagonal();
  // What the frontend could not see, bundle adjustment must not invent from the same scans.
  const WindowFrame& frame = frames_[i];
  for (int k = 0; k < 6 && frame.held_information(k) > 0.0; ++k) {
    Vector6d direction = frame.held.col(k);
    direction.head<3>() *= kRotationArmM;
    direction.tail<3>() = frames_[i - 1].T_world_lidar.q.conjugate() * direction.tail<3>();
    information += frame.held_information(k) * direction * direction.transpose();
  }
  prior.sqrt_information = information.llt().matrixU();
  return prior;
}

}  // namespace lamina
