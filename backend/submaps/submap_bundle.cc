#include "backend/submaps/submap_bundle.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <unordered_map>

#include "backend/anchors/anchor_prior.h"
#include "backend/bundle/uncertainty/observability.h"
#include "backend/submaps/association_rounds.h"
#include "core/base/disjoint_sets.h"
#include "core/base/parallel.h"
#include "core/geometry/robust_kernel.h"
#include "core/geometry/state_archive.h"

namespace lamina {
namespace {

// What is done when a round moves no anchor by more.
constexpr double kSettledM = 0.001, kSettledRad = 1e-4;

// Submaps that edges join, by position, and those edges among them.
struct Part {
  std::vector<std::size_t> submaps;
  std::vector<RelativePrior> priors;
};

std::vector<Part> PartsOf(const AnchorGraph& graph) {
  DisjointSets joined(graph.poses.size());
  for (const auto* edges : {&graph.odometry, &graph.loops}) {
    for (const AnchorEdge& edge : *edges) joined.Join(edge.from, edge.to);
  }
  std::vector<Part> parts;
  std::vector<std::size_t> part(graph.poses.size()), place(graph.poses.size());
  for (std::size_t i = 0; i < part.size(); ++i) {
    if (joined.Find(i) == i) {
      part[i] = parts.size();
      parts.emplace_back();
    }
    part[i] = part[joined.Find(i)];
    place[i] = parts[part[i]].submaps.size();
    parts[part[i]].submaps.push_back(i);
  }
  for (const auto* edges : {&graph.odometry, &graph.loops}) {
    for (const AnchorEdge& edge : *edges) {
      RelativePrior prior = PriorOf(edge);
      prior.a = static_cast<int>(place[edge.from]);
      prior.b = static_cast<int>(place[edge.to]);
      parts[part[edge.from]].priors.push_back(prior);
    }
  }
  return parts;
}

// The position of the sensor, in the submap's frame, from which it has seen a place: that of the
// nearest keyframe.
Eigen::Vector3d SeenFrom(const Submap& submap, const Eigen::Vector3d& p) {
  Eigen::Vector3d nearest = Eigen::Vector3d::Zero();
  double least = std::numeric_limits<double>::infinity();
  for (const SubmapKeyframe& keyframe : submap.keyframes) {
    const double distance = (keyframe.T_submap_lidar.t - p).squaredNorm();
    if (distance >= least) continue;
    least = distance;
    nearest = keyframe.T_submap_lidar.t;
  }
  return nearest;
}

// The submaps of a part cast into one map.
class CastSubmaps {
 public:
  CastSubmaps(const std::vector<const Submap*>& submaps, const std::vector<SE3>& anchors,
              const VoxelMapOptions& map)
      : submaps_(submaps), anchors_(anchors), map_(map), leaves_(submaps.size()) {
    for (std::size_t k = 0; k < submaps_.size(); ++k) {
      const Eigen::Matrix3d R = anchors_[k].R();
      for (const SubmapLeaf& leaf : submaps_[k]->Leaves()) {
        const PointCluster cluster = submaps_[k]->Cluster(leaf).Moved(R, anchors_[k].t);
        VoxelMap::NodeId node = VoxelMap::kNoNode;
        if (map_.CanHold(cluster.mean)) {
          node = map_.LeafAt(cluster.mean);
          map_.AddWindow(node, cluster, static_cast<std::int64_t>(k));
        }
        leaves_[k].push_back(node);
      }
      fits_ = static_cast<double>(map_.bytes()) <= map.BudgetBytes();
      if (!fits_) return;
    }
    map_.Refresh();
  }

  // Whether the map's budget holds them.
  bool fits() const { return fits_; }

  BundleProblem Problem(const SubmapBundleOptions& options) const {
    std::vector<std::vector<Seen>> seen(submaps_.size());
    ParallelChunks(submaps_.size(), 1,
                   [&](std::size_t k, std::size_t) { seen[k] = SeenBy(k, options.kernel_sigma); });
    std::unordered_map<std::int64_t, std::size_t> number;
    std::vector<std::vector<PlaneObservation>> planes;
    std::vector<VoxelMap::NodeId> nodes;
    for (std::size_t k = 0; k < seen.size(); ++k) {
      for (const Seen& s : seen[k]) {
        const auto [at, fresh] = number.try_emplace(s.key, planes.size());
        if (fresh) {
          planes.emplace_back();
          nodes.push_back(static_cast<VoxelMap::NodeId>(s.key / 2));
        }
        std::vector<PlaneObservation>& plane = planes[at->second];
        if (plane.empty() || plane.back().frame != static_cast<int>(k))
          plane.push_back({static_cast<int>(k), {}});
        plane.back().cluster += s.cluster;
      }
    }
    BundleProblem problem;
    problem.poses = anchors_;
    for (std::size_t i = 0; i < planes.size(); ++i) {
      if (planes[i].size() < 2) continue;
      Plane plane;
      plane.first = static_cast<std::int32_t>(problem.observations.size());
      plane.count = static_cast<std::int32_t>(planes[i].size());
      plane.weight = PlaneWeight(static_cast<double>(map_.plane(nodes[i]).variance),
                                 map_.options().noise_floor_m);
      for (PlaneObservation& o : planes[i]) {
        o.cluster = o.cluster.Capped(options.max_cluster_weight);
        problem.observations.push_back(o);
      }
      problem.planes.push_back(plane);
    }
    return problem;
  }

 private:
  struct Seen {
    std::int64_t key;      // node and side
    PointCluster cluster;  // weighted, frame of the submap
  };

  std::vector<Seen> SeenBy(std::size_t k, double kernel_sigma) const {
    const Submap& submap = *submaps_[k];
    std::vector<Seen> seen;
    const SubmapLeaves leaves = submap.Leaves();
    for (std::size_t i = 0; i < std::min(leaves.size(), leaves_[k].size()); ++i) {
      if (leaves_[k][i] == VoxelMap::kNoNode) continue;
      const VoxelMap::NodeId node = map_.PlaneAbove(leaves_[k][i]);
      if (node == VoxelMap::kNoNode) continue;
      const Surface& surface = map_.plane(node);
      const Eigen::Vector3d normal = surface.normal.cast<double>();
      const PointCluster cluster = submap.Cluster(leaves[i]);
      const Eigen::Vector3d mean = anchors_[k] * cluster.mean;
      const Eigen::Vector3d sensor = anchors_[k] * SeenFrom(submap, cluster.mean);
      const double weight = KernelWeight(surface, mean, map_.options().noise_floor_m, kernel_sigma);
      seen.push_back(
          {2 * static_cast<std::int64_t>(node) + (normal.dot(sensor - mean) < 0.0 ? 1 : 0),
           cluster.Scaled(weight)});
    }
    return seen;
  }

  const std::vector<const Submap*>& submaps_;
  const std::vector<SE3>& anchors_;
  VoxelMap map_;
  std::vector<std::vector<VoxelMap::NodeId>> leaves_;
  bool fits_ = true;
};

// All moved as one so that the first stays.
void KeepFirst(const SE3& T_first, std::vector<SE3>* anchors) {
  const SE3 back = T_first * anchors->front().Inverse();
  for (SE3& T : *anchors) T = back * T;
}

// What a round comes to.
struct Round {
  std::vector<SE3> anchors;
  std::size_t planes = 0, observations = 0;
  std::string refusal;

  void Archive(StateArchive& a) { a(&anchors, &planes, &observations, &refusal); }
};

// The submaps of a part, and what holds them.
struct PartProblem {
  std::vector<const Submap*> submaps;
  const std::vector<RelativePrior>& priors;
  const SubmapBundleOptions& options;
  const VoxelMapOptions& map;
};

Round SolveRound(const PartProblem& part, const std::vector<SE3>& anchors, bool first) {
  Round round;
  VoxelMapOptions sized = part.map;
  if (first) sized.max_thickness_m *= kFirstRoundThickness;
  const CastSubmaps cast(part.submaps, anchors, WithinRange(sized));
  if (!cast.fits()) {
    round.refusal = "all submaps at once are more than map.budget_mb";
    return round;
  }
  BundleProblem problem = cast.Problem(part.options);
  const Observability observability =
      FindObservability(problem, {}, first ? Slides::kFree : Slides::kHeld);
  problem.holds = observability.holds;
  problem.hold_first_pose = false;
  problem.priors = part.priors;
  const BundleResult solved = AdjustBundle(problem, kRoundSolver);
  if (!solved.usable() || MovesBetween(anchors, solved.poses).largest_m > part.map.root_size_m) {
    round.refusal = solved.usable() ? "an anchor was carried farther than a voxel"
                                    : "too few planes are shared, or the solver failed";
    return round;
  }
  round.planes = problem.planes.size();
  round.observations = problem.observations.size();
  round.anchors = solved.poses;
  return round;
}

// The same, out of the journal where it is there.
Round SolveOrFind(const PartProblem& part, std::vector<SE3> anchors, bool first,
                  ResultJournal* journal) {
  if (journal == nullptr) return SolveRound(part, anchors, first);
  StateArchive key;
  std::string kind = "round";
  key(&kind, &first, &anchors);
  if (const auto known = journal->Find(key.written())) {
    Round round;
    StateArchive archive{std::string_view(*known)};
    archive(&round);
    return round;
  }
  Round round = SolveRound(part, anchors, first);
  StateArchive archive;
  archive(&round);
  journal->Add(key.written(), archive.written());
  journal->Sync();
  return round;
}

// The anchors of a part; *result gets its figures.
std::vector<SE3> AdjustPart(const PartProblem& part, std::vector<SE3> anchors,
                            const SubmapBundleWork& work, SubmapBundleResult* result) {
  const SE3 T_first = anchors.front();
  Round last;
  for (int i = 0; i < part.options.rounds; ++i) {
    Round round = SolveOrFind(part, anchors, i == 0, work.journal);
    if (!round.refusal.empty()) {
      result->refusal = round.refusal;
      break;
    }
    const PoseMoves moves = MovesBetween(anchors, round.anchors);
    anchors = round.anchors;
    last = std::move(round);
    ++result->rounds;
    if (work.on_round) work.on_round(result->rounds, moves.largest_m);
    if (i > 0 && moves.largest_m < kSettledM && moves.largest_rad < kSettledRad) break;
  }
  result->planes += last.planes;
  result->observations += last.observations;
  KeepFirst(T_first, &anchors);
  return anchors;
}

}  // namespace

void SubmapBundleOptions::Visit(OptionVisitor& v) {
  v.Integer("rounds", &rounds, 0, 100);
  v.Number("max_cluster_weight", &max_cluster_weight, 1.0, 1e6);
  v.Number("kernel_sigma", &kernel_sigma, 0.1, 100.0);
}

SubmapBundleResult AdjustSubmaps(const std::vector<const Submap*>& submaps,
                                 const AnchorGraph& graph, const SubmapBundleOptions& options,
                                 const VoxelMapOptions& map, const SubmapBundleWork& work) {
  CheckOptions(options, "loops.bundle");
  SubmapBundleResult result;
  result.anchors = graph.poses;
  for (const Part& part : PartsOf(graph)) {
    if (part.submaps.size() < 2) continue;
    PartProblem problem = {{}, part.priors, options, map};
    std::vector<SE3> anchors;
    for (const std::size_t i : part.submaps) {
      problem.submaps.push_back(submaps[i]);
      anchors.push_back(graph.poses[i]);
    }
    anchors = AdjustPart(problem, anchors, work, &result);
    for (std::size_t i = 0; i < anchors.size(); ++i) result.anchors[part.submaps[i]] = anchors[i];
  }
  result.largest_move_m = MovesBetween(graph.poses, result.anchors).largest_m;
  return result;
}

}  // namespace lamina
