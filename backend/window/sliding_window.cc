#include "backend/window/sliding_window.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <utility>

#include "backend/bundle/plane_choice.h"
#include "backend/window/observation_weights.h"
#include "core/base/angle.h"
#include "core/base/parallel.h"
#include "core/geometry/cluster_lanes.h"
#include "core/geometry/degeneracy.h"
#include "core/geometry/sweep_motion.h"

namespace lamina {
namespace {

// Stands for a path where the cluster is in no leaf.
constexpr std::uint64_t kNoLeaf = ~std::uint64_t{0};

// How far `to` is from `from` along a unit vector of the scaled tangent, either way.
double DistanceAlong(const Vector6d& direction, const SE3& from, const SE3& to) {
  return std::abs(direction.dot(ScaledDelta(from, to)));
}

}  // namespace

// Finds the places of a problem's observations: those of a plane stand together, frames ascending;
// planes in the order in which they are met. Frames must be walked in order.
class ObservationPlaces {
 public:
  // `planes`: how many planes of the map there are.
  explicit ObservationPlaces(std::size_t planes) : number_of_(planes, -1) {}

  // Adds an observation of plane `on` of the map. Returns its number, the same one for all that a
  // frame sees of a plane.
  std::int32_t Add(std::int32_t on, int frame) {
    std::int32_t& plane = number_of_[static_cast<std::size_t>(on)];
    if (plane < 0) {
      plane = static_cast<std::int32_t>(planes_.size());
      planes_.push_back({on, -1, -1, 0});
    }
    OfPlane& of = planes_[static_cast<std::size_t>(plane)];
    if (of.last_frame != frame) {
      of.last_frame = frame;
      of.last = static_cast<std::int32_t>(plane_of_.size());
      ++of.observations;
      plane_of_.push_back(plane);
    }
    return of.last;
  }

  // Makes planes and observations, empty. Returns the place of each number of Add.
  std::vector<std::int32_t> MakeIn(BundleProblem* problem) const {
    problem->planes.assign(planes_.size(), Plane());
    std::vector<std::int32_t> next;
    next.reserve(planes_.size());
    std::int32_t first = 0;
    for (std::size_t p = 0; p < planes_.size(); ++p) {
      problem->planes[p].first = first;
      problem->planes[p].count = planes_[p].observations;
      next.push_back(first);
      first += planes_[p].observations;
    }
    problem->observations.resize(plane_of_.size());
    std::vector<std::int32_t> places;
    places.reserve(plane_of_.size());
    for (const std::int32_t plane : plane_of_) {
      places.push_back(next[static_cast<std::size_t>(plane)]++);
    }
    return places;
  }

  // The map's plane behind plane i of the problem.
  std::int32_t MapPlane(std::size_t i) const { return planes_[i].on; }

 private:
  struct OfPlane {
    std::int32_t on, last_frame, last, observations;
  };
  std::vector<std::int32_t> number_of_;  // of each plane of the map; -1: none yet
  std::vector<OfPlane> planes_;
  std::vector<std::int32_t> plane_of_;  // of each observation
};

void SlidingWindowOptions::Visit(OptionVisitor& v) {
  v.Integer("frames", &frames, 2, 200);
  v.Number("kernel_sigma", &kernel_sigma, 0.1, 1e3);
  v.Integer("max_planes", &max_planes, 10, 10000000);
  v.Number("prior_rotation_deg", &prior_rotation_deg, 1e-4, 180.0);
  v.Number("prior_translation_m", &prior_translation_m, 1e-4, 1e3);
}

void WindowFrame::SetWeakest(const Matrix6d& covariance, const SE3& T_world_predicted) {
  const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(TimesArm(covariance));
  weakest = solver.eigenvectors().col(5);
  const bool confirmed =
      DistanceAlong(weakest, T_world_predicted, T_world_lidar) <= SlidingWindow::kAstrayM;
  weakest_sigma_m = confirmed ? std::sqrt(std::max(0.0, solver.eigenvalues()(5))) : 0.0;
}

SlidingWindow::SlidingWindow(const SlidingWindowOptions& options, VoxelMap* map)
    : options_(options), map_(map) {
  CheckOptions(options, "backend.window");
}

void SlidingWindow::MoveIntoMap(const WindowFrame& frame, const SE3& T,
                                std::vector<PointCluster>* in_map) const {
  const Eigen::Matrix3d R = T.R();
  const double most =
      frame.alone ? std::max<double>(map_->options().max_cluster_weight, map_->options().min_points)
                  : map_->options().max_cluster_weight;
  in_map->resize(frame.deskewed.size());
  ParallelChunks(frame.deskewed.size(), 2048, [&](std::size_t begin, std::size_t end) {
    MoveClusters(frame.deskewed.data() + begin, end - begin, most, R, T.t, in_map->data() + begin);
  });
}

void SlidingWindow::Push(WindowFrame frame) {
  frame.deskewed = DeskewClusters(frame.measured, frame.sweep);
  if (!AnyTimed(frame.measured)) frame.measured.clear();
  MoveIntoMap(frame, frame.T_world_lidar, &frame.in_map);
  AddToMap(&frame);
  frames_.push_back(std::move(frame));
}

void SlidingWindow::AddToMap(WindowFrame* frame) {
  frame->addresses.assign(frame->in_map.size(), {0, kNoLeaf});
  frame->leaves = map_->AddFrame(frame->in_map, frame->id, &frame->addresses);
}

double SlidingWindow::ShareAstray() const {
  std::size_t all = 0, astray = 0;
  for (const WindowFrame& frame : frames_) {
    for (std::size_t k = 0; k < frame.in_map.size(); ++k) {
      if (frame.leaves[k] == VoxelMap::kNoNode) continue;
      ++all;
      const Eigen::Vector3d& p = frame.in_map[k].mean;
      const VoxelMap::LeafAddress& then = frame.addresses[k];
      const LeafPlace now = map_->CanHold(p) ? map_->PlaceOf(p) : LeafPlace();
      astray += now.key != then.root || now.path != then.path ? 1 : 0;
    }
  }
  return all == 0 ? 0.0 : static_cast<double>(astray) / static_cast<double>(all);
}

void SlidingWindow::AddAnew() {
  for (WindowFrame& frame : frames_) AddToMap(&frame);
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

void SlidingWindow::PrefetchLeaves(const WindowFrame& frame, std::size_t i) const {
  if (i + 2 * VoxelMap::kLeavesAhead < frame.leaves.size()) {
    map_->Prefetch(frame.leaves[i + 2 * VoxelMap::kLeavesAhead]);
  }
  if (i + VoxelMap::kLeavesAhead < frame.leaves.size())
    map_->PrefetchAround(frame.leaves[i + VoxelMap::kLeavesAhead]);
}

void SlidingWindow::PopOldest(FinalKeyframe* left) {
  const WindowFrame& frame = frames_.front();
  if (left != nullptr) {
    *left = {frame.id, frame.stamp_ns, frame.T_world_lidar, {}};
    left->clusters.reserve(frame.in_map.size());
  }
  for (std::size_t i = 0; i < frame.in_map.size(); ++i) {
    PrefetchLeaves(frame, i);
    if (frame.leaves[i] == VoxelMap::kNoNode) continue;
    const double weight = MarginalWeight(frame, i);
    if (left != nullptr) left->clusters.push_back(frame.in_map[i].Scaled(weight));
    map_->FixWindow(frame.leaves[i], frame.in_map[i], weight, frame.id);
    map_->Release(frame.leaves[i]);
  }
  AddNeighbour({frame.stamp_ns, frame.T_world_lidar}, &left_);
  frames_.pop_front();
}

double SlidingWindow::MarginalWeight(const WindowFrame& frame, std::size_t i) const {
  // Least weight: clusters that stay for good must be able to overrule those that were there.
  constexpr double kLeast = 0.005;
  if (!frame.weights.empty() && frame.weights[i] >= 0.0) return std::max(kLeast, frame.weights[i]);
  // An object before a wall may keep both together from being a plane, where the fixed clusters of
  // the wall alone are one.
  const PointCluster fixed = map_->FixedAggregate(frame.leaves[i]);
  const Surface surface = map_->SurfaceOf(fixed, 0);
  if (surface.kind != Surface::Kind::kPlane) return 1.0;
  return std::max(kLeast, KernelWeight(surface, frame.in_map[i].mean, map_->options().noise_floor_m,
                                       options_.kernel_sigma));
}

void SlidingWindow::Move(std::size_t i, const SE3& T_world_lidar, const SweepMotion& sweep) {
  WindowFrame& frame = frames_[i];
  frame.T_world_lidar = T_world_lidar;
  if (!frame.measured.empty()) {
    frame.sweep = sweep;
    DeskewClusters(frame.measured, sweep, &frame.deskewed);
  }
  MoveIntoMap(frame, T_world_lidar, &moved_);
  map_->ReplaceWindow(frame.leaves, frame.in_map, moved_);
  frame.in_map.swap(moved_);
}

SweepMotion SlidingWindow::MotionAt(std::size_t i, const StampedPose* next,
                                    double max_gap_s) const {
  // Poses that have left the window stay neighbours of its oldest frames.
  Trajectory poses = left_;
  for (std::size_t k = i - std::min(i, kMotionNeighbours);
       k < std::min(i + kMotionNeighbours + 1, frames_.size()); ++k) {
    poses.push_back({frames_[k].stamp_ns, frames_[k].T_world_lidar});
  }
  if (next != nullptr) poses.push_back(*next);
  SweepMotion motion = frames_[i].sweep;
  MotionThrough(poses, left_.size() + std::min(i, kMotionNeighbours), max_gap_s, &motion);
  return motion;
}

bool SlidingWindow::HoldAstray(const std::vector<std::int64_t>& ids,
                               const std::vector<SE3>& poses) {
  constexpr double kSigmas = 3.0, kHeldM = 0.001;
  const std::int64_t first = frames_.front().id;
  bool any = false;
  SE3 before = poses.front();  // the frame before, or where it should be
  for (std::size_t k = 1; k < ids.size(); ++k) {
    const SE3 last = std::exchange(before, poses[k]);
    if (ids[k] < first) continue;
    WindowFrame& frame = frames_[static_cast<std::size_t>(ids[k] - first)];
    if (frame.weakest_sigma_m <= 0.0) continue;
    const SE3 expected = last * frame.T_previous_this;
    if (DistanceAlong(frame.weakest, expected, poses[k]) <=
        std::max(kAstrayM, kSigmas * frame.weakest_sigma_m))
      continue;
    before = expected;
    frame.held.col(0) = frame.weakest;
    frame.held_information(0) = 1.0 / (kHeldM * kHeldM);
    frame.weakest_sigma_m = 0.0;
    any = true;
  }
  return any;
}

BundleProblem SlidingWindow::BuildProblem() {
  BundleProblem problem;
  const ObservationWeights on_planes(*map_, frames_, options_.kernel_sigma);
  ObservationPlaces numbers(on_planes.nodes().size());
  std::vector<std::vector<std::int32_t>> of_clusters;
  for (std::size_t f = 0; f < frames_.size(); ++f) {
    frames_[f].weights = on_planes.Weights(f);
    problem.poses.push_back(frames_[f].T_world_lidar);
    if (f > 0) problem.priors.push_back(MotionPrior(f));
    of_clusters.push_back(NumberObservations(f, on_planes, &numbers));
  }
  const std::vector<std::int32_t> places = numbers.MakeIn(&problem);
  for (std::size_t f = 0; f < frames_.size(); ++f) {
    FillObservations(f, of_clusters[f], places, &problem);
  }
  for (std::size_t i = 0; i < problem.planes.size(); ++i) {
    Plane& plane = problem.planes[i];
    const VoxelMap::NodeId node = on_planes.nodes()[static_cast<std::size_t>(numbers.MapPlane(i))];
    plane.fixed = map_->FixedAggregate(node);
    plane.weight =
        PlaneWeight(static_cast<double>(map_->plane(node).variance), map_->options().noise_floor_m);
    if (!plane.fixed.Empty()) problem.hold_first_pose = false;
  }
  if (!frames_.empty()) HoldFirst(&problem);
  KeepBinding(options_.max_planes, &problem.planes);
  DistrustThick(&problem.planes);
  return problem;
}

std::vector<std::int32_t> SlidingWindow::NumberObservations(std::size_t f,
                                                            const ObservationWeights& on_planes,
                                                            ObservationPlaces* numbers) const {
  const WindowFrame& frame = frames_[f];
  std::vector<std::int32_t> of_clusters(frame.leaves.size(), -1);
  for (std::size_t i = 0; i < frame.leaves.size(); ++i) {
    const std::int32_t plane = on_planes.PlaneOf(f, i);
    if (plane == ObservationWeights::kNone) continue;
    of_clusters[i] = numbers->Add(plane, static_cast<int>(f));
  }
  return of_clusters;
}

void SlidingWindow::FillObservations(std::size_t f, const std::vector<std::int32_t>& of_clusters,
                                     const std::vector<std::int32_t>& places,
                                     BundleProblem* problem) const {
  const WindowFrame& frame = frames_[f];
  for (std::size_t i = 0; i < of_clusters.size(); ++i) {
    if (of_clusters[i] < 0) continue;
    const std::int32_t place = places[static_cast<std::size_t>(of_clusters[i])];
    const PointCluster weighted =
        frame.deskewed[i].Capped(map_->options().max_cluster_weight).Scaled(frame.weights[i]);
    PlaneObservation& observation = problem->observations[static_cast<std::size_t>(place)];
    observation.frame = static_cast<int>(f);
    observation.cluster += weighted;
  }
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
  a(&left_);
  frames_.resize(a.Size(frames_.size(), 1));
  for (WindowFrame& frame : frames_) {
    a(&frame.id, &frame.stamp_ns, &frame.T_world_lidar, &frame.sweep.twist,
      &frame.sweep.acceleration, &frame.sweep.of_scan, &frame.held, &frame.held_information,
      &frame.T_previous_this, &frame.weakest, &frame.weakest_sigma_m, &frame.alone, &frame.weights,
      &frame.measured);
    // Members that follow from others are computed again.
    if (frame.measured.empty()) {
      a(&frame.deskewed);
    } else if (a.reading()) {
      frame.deskewed = DeskewClusters(frame.measured, frame.sweep);
    }
    a(&frame.addresses);
    if (!a.reading()) continue;
    MoveIntoMap(frame, frame.T_world_lidar, &frame.in_map);
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
  root << Eigen::Vector3d::Constant(Degrees(1.0) / options_.prior_rotation_deg),
      Eigen::Vector3d::Constant(1.0 / options_.prior_translation_m);
  Matrix6d information = root.cwiseAbs2().asDiagonal();
  // Directions that the frontend's planes left open must not be determined by bundle adjustment
  // from the same scans.
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
