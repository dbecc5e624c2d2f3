#include "backend/loops/loop_closure.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <list>
#include <queue>
#include <utility>

#include "backend/loops/loop_agreement.h"
#include "backend/places/submap_place.h"
#include "backend/submaps/map_assembly.h"
#include "core/base/angle.h"
#include "core/base/parallel.h"

namespace lamina {
namespace {

// What an edge is off by however short the way: submaps are not quite rigid.
constexpr double kInnerSigmaM = 0.05, kInnerSigmaDeg = 0.1;
// What the bounds on drift allow on top of their share of the way.
const PoseDifference kSlack{1.5, Radians(3.0)};
// Beside a corrected map the prediction is a hypothesis of its own.
constexpr double kPredictedWithinM = 6.0;
constexpr std::size_t kPredictions = 3;

Matrix6d Isotropic(double rotation_sigma, double translation_sigma) {
  Vector6d variances;
  variances << Eigen::Vector3d::Constant(rotation_sigma * rotation_sigma),
      Eigen::Vector3d::Constant(translation_sigma * translation_sigma);
  return variances.asDiagonal();
}

}  // namespace

const char* ToString(Loop::Status status) {
  switch (status) {
    case Loop::Status::kAccepted:
      return "accepted";
    case Loop::Status::kWaiting:
      return "waiting";
    case Loop::Status::kRefused:
      break;
  }
  return "refused";
}

// The voxel maps of the submaps that were registered against last.
class LoopClosure::Targets {
 public:
  explicit Targets(const VoxelMapOptions& map) : map_(map) {}

  // For all of these, made in parallel where they are not there.
  std::vector<const SubmapTarget*> Of(const std::vector<std::size_t>& positions,
                                      const std::vector<Submap>& submaps) {
    std::vector<std::size_t> missing;
    for (const std::size_t position : positions) {
      const auto found = Find(submaps[position].id);
      if (found != kept_.end()) {
        kept_.splice(kept_.begin(), kept_, found);
      } else {
        kept_.push_front({submaps[position].id, nullptr});
        missing.push_back(position);
      }
    }
    std::vector<std::unique_ptr<SubmapTarget>> made(missing.size());
    ParallelChunks(missing.size(), 1, [&](std::size_t i, std::size_t) {
      made[i] = std::make_unique<SubmapTarget>(submaps[missing[i]], map_);
    });
    for (std::size_t i = 0; i < missing.size(); ++i)
      Find(submaps[missing[i]].id)->target = std::move(made[i]);
    while (kept_.size() > std::max(kMost, positions.size())) kept_.pop_back();
    std::vector<const SubmapTarget*> targets;
    for (const std::size_t position : positions)
      targets.push_back(Find(submaps[position].id)->target.get());
    return targets;
  }

 private:
  static constexpr std::size_t kMost = 16;
  struct Kept {
    std::int64_t id;
    std::unique_ptr<SubmapTarget> target;
  };
  std::list<Kept>::iterator Find(std::int64_t id) {
    return std::find_if(kept_.begin(), kept_.end(),
                        [&](const Kept& kept) { return kept.id == id; });
  }

  VoxelMapOptions map_;
  std::list<Kept> kept_;  // the last used first
};

LoopClosure::LoopClosure(const LoopOptions& options, const VoxelMapOptions& map,
                         const ScanMatcherOptions& matcher, const ByteStore* store)
    : options_(options),
      store_(store),
      registration_(matcher),
      targets_(std::make_unique<Targets>(map)) {
  CheckOptions(options, "loops");
  // Between two visits of one drive nothing of much leaves.
  options_.verification.max_gone_agreeing = options_.verification.max_gone;
}
LoopClosure::~LoopClosure() = default;

double LoopClosure::WayM(std::size_t submap) const {
  const Submap& from = submaps_[submap];
  if (submap + 1 == submaps_.size() || !Follows(submaps_[submap + 1], from)) return from.way_m;
  const Eigen::Vector3d last = from.T_world_submap * from.keyframes.back().T_submap_lidar.t;
  return std::max(from.way_m, (submaps_[submap + 1].T_world_submap.t - last).norm());
}

double LoopClosure::WayToNextM(std::size_t submap) const {
  return Follows(submaps_[submap + 1], submaps_[submap])
             ? WayM(submap)
             : places_[submap + 1].way_m - places_[submap].way_m;
}

AnchorEdge LoopClosure::OdometryEdge(std::size_t to) const {
  const Submap &a = submaps_[to - 1], &b = submaps_[to];
  const double way_m = WayToNextM(to - 1);
  AnchorEdge edge{to - 1, to, a.T_world_submap.Inverse() * b.T_world_submap, {}};
  const double rotation =
      Radians(std::hypot(kInnerSigmaDeg, 0.01 * options_.drift_sigma_deg_per_100m * way_m));
  const double translation = std::hypot(kInnerSigmaM, 0.01 * options_.drift_sigma_percent * way_m);
  edge.information = Isotropic(rotation, translation).inverse();
  return edge;
}

AnchorEdge EdgeOf(const Loop& loop) {
  AnchorEdge edge{loop.from, loop.to, loop.match.T_other_query, {}};
  // The translation of a match is perturbed in the frame of the other submap.
  Matrix6d J = Matrix6d::Identity();
  J.bottomRightCorner<3, 3>() = edge.T_from_to.R().transpose();
  const Matrix6d covariance =
      J * loop.match.covariance * J.transpose() + Isotropic(Radians(kInnerSigmaDeg), kInnerSigmaM);
  edge.information = covariance.inverse();
  edge.information = 0.5 * (edge.information + edge.information.transpose().eval());
  return edge;
}

AnchorGraph LoopClosure::graph() const {
  AnchorGraph graph;
  graph.poses = anchors_;
  for (std::size_t i = 1; i < submaps_.size(); ++i) graph.odometry.push_back(OdometryEdge(i));
  for (const Loop& loop : loops_) {
    if (loop.status != Loop::Status::kAccepted) continue;
    graph.loops.push_back(EdgeOf(loop));
    graph.kept_before.push_back(loop.solved);
  }
  return graph;
}

void LoopClosure::Add(Submap submap) {
  const bool follows = !submaps_.empty();
  SE3 anchor = submap.T_world_submap;
  Place place;
  if (follows) {
    const SE3 T_this_last = submap.T_world_submap.Inverse() * submaps_.back().T_world_submap;
    if (corrected_) anchor = anchors_.back() * T_this_last.Inverse();
  }
  std::vector<LeafPlane> planes = LeafPlanes(submap);
  place.image = ImageOfSubmap(submap, planes, follows ? &submaps_.back() : nullptr,
                              follows ? &places_.back().image : nullptr, options_.place);
  const SubmapQuery query = QueryOfSubmap(submap, std::move(planes), place.image);
  submaps_.push_back(std::move(submap));
  if (follows) place.way_m = places_.back().way_m + WayM(submaps_.size() - 2);
  places_.push_back(std::move(place));
  anchors_.push_back(anchor);
  FindLoops(query);
  if (AcceptAgreeing()) Correct();
  submaps_.back().Release();
  Trim();
}

void LoopClosure::Trim() {
  std::vector<double> ways;
  for (const Place& place : places_) ways.push_back(place.way_m);
  while (const auto dispensable = FindDispensable({submaps_, anchors_, ways, loops_}, options_)) {
    ways.erase(ways.begin() + static_cast<std::ptrdiff_t>(dispensable->submap));
    TakeOut(*dispensable);
  }
}

void LoopClosure::TakeOut(const DispensableSubmap& dispensable) {
  const std::size_t out = dispensable.submap;
  const Submap& submap = submaps_[out];
  const SE3 T_holder_submap = anchors_[dispensable.holder].Inverse() * anchors_[out];
  for (TrimmedSubmap& trimmed : trimmed_) {
    if (trimmed.holder != out) continue;
    trimmed.holder = dispensable.holder;
    trimmed.T_holder_submap = T_holder_submap * trimmed.T_holder_submap;
  }
  const TrimmedSubmap left{dispensable.holder, MiddleNs(submap), submap.T_world_submap,
                           T_holder_submap};
  const auto later = [](const TrimmedSubmap& a, const TrimmedSubmap& b) {
    return a.middle_ns < b.middle_ns;
  };
  trimmed_.insert(std::upper_bound(trimmed_.begin(), trimmed_.end(), left, later), left);
  loops_.erase(std::remove_if(loops_.begin(), loops_.end(),
                              [&](const Loop& loop) { return loop.from == out || loop.to == out; }),
               loops_.end());
  const auto close_gap = [&](std::size_t* position) { *position -= *position > out ? 1 : 0; };
  for (Loop& loop : loops_) {
    close_gap(&loop.from);
    close_gap(&loop.to);
  }
  for (TrimmedSubmap& trimmed : trimmed_) close_gap(&trimmed.holder);
  const auto at = static_cast<std::ptrdiff_t>(out);
  submaps_.erase(submaps_.begin() + at);
  places_.erase(places_.begin() + at);
  anchors_.erase(anchors_.begin() + at);
}

std::vector<double> LoopClosure::Ways() const {
  std::vector<std::vector<std::size_t>> joined(submaps_.size());
  for (const Loop& loop : loops_) {
    if (loop.status != Loop::Status::kAccepted) continue;
    joined[loop.from].push_back(loop.to);
    joined[loop.to].push_back(loop.from);
  }
  std::vector<double> ways(submaps_.size(), std::numeric_limits<double>::infinity());
  std::priority_queue<std::pair<double, std::size_t>> open;
  const auto reach = [&](double way, std::size_t id) {
    if (way >= ways[id]) return;
    ways[id] = way;
    open.push({-way, id});
  };
  reach(0.0, submaps_.size() - 1);
  while (!open.empty()) {
    const auto [negative, id] = open.top();
    open.pop();
    if (-negative > ways[id]) continue;
    if (id > 0) reach(ways[id] + WayToNextM(id - 1), id - 1);
    if (id + 1 < submaps_.size()) reach(ways[id] + WayToNextM(id), id + 1);
    for (const std::size_t other : joined[id]) reach(ways[id], other);
  }
  return ways;
}

std::vector<LoopClosure::Hypothesis> LoopClosure::Hypotheses(
    const std::vector<double>& ways) const {
  const std::size_t query = submaps_.size() - 1;
  const auto middle = [&](std::size_t id) {
    return Eigen::Vector3d(anchors_[id] * places_[id].image.middle());
  };
  const Eigen::Vector3d here = middle(query);
  const double reach_m = PlaceImage::kRadius * options_.place.cell_size_m;
  std::vector<std::size_t> others;
  std::vector<const PlaceImage*> images;
  std::vector<std::pair<double, std::size_t>> near;
  for (std::size_t id = 0; id < query; ++id) {
    if (places_[query].way_m - places_[id].way_m - WayM(id) < options_.min_way_m) continue;
    const double distance = (middle(id) - here).norm(),
                 drift = WithDrift(kSlack, options_, ways[id]).m;
    if (distance > drift + reach_m) continue;
    others.push_back(id);
    images.push_back(&places_[id].image);
    if (drift < kPredictedWithinM && distance < options_.submap.length_m + drift)
      near.emplace_back(distance, id);
  }
  std::vector<Hypothesis> hypotheses;
  if (others.empty()) return hypotheses;
  for (const PlaceHypothesis& found : LookUpPlace(places_[query].image, images, options_.place)) {
    if (hypotheses.size() == static_cast<std::size_t>(options_.registrations)) break;
    hypotheses.push_back({others[found.other], found.T_other_query, found.score, false});
  }
  std::sort(near.begin(), near.end());
  for (std::size_t i = 0; i < std::min(near.size(), kPredictions); ++i) {
    const std::size_t id = near[i].second;
    hypotheses.push_back({id, anchors_[id].Inverse() * anchors_[query], 0.0, true});
  }
  return hypotheses;
}

void LoopClosure::FindLoops(const SubmapQuery& query) {
  const std::size_t to = submaps_.size() - 1;
  const std::vector<double> ways = Ways();
  const std::vector<Hypothesis> hypotheses = Hypotheses(ways);
  std::vector<std::size_t> ids;
  for (const Hypothesis& hypothesis : hypotheses) {
    if (std::find(ids.begin(), ids.end(), hypothesis.other) == ids.end())
      ids.push_back(hypothesis.other);
  }
  const std::vector<const SubmapTarget*> targets = targets_->Of(ids, submaps_);
  std::vector<Loop> found(hypotheses.size());
  ParallelChunks(hypotheses.size(), 1, [&](std::size_t i, std::size_t) {
    const Hypothesis& hypothesis = hypotheses[i];
    const auto at = std::find(ids.begin(), ids.end(), hypothesis.other) - ids.begin();
    Loop& loop = found[i];
    loop.from = hypothesis.other;
    loop.to = to;
    loop.score = hypothesis.score;
    loop.way_m = ways[hypothesis.other];
    loop.match = registration_.Register(query, *targets[static_cast<std::size_t>(at)],
                                        hypothesis.T_other_query);
    loop.reason = Refusal(loop.match, options_.verification);
    if (loop.reason.empty()) loop.reason = DriftRefusal(loop);
    if (loop.reason.empty()) loop.status = Loop::Status::kWaiting;
  });
  // The best of each other submap: what is not refused, then what more planes speak for.
  std::stable_sort(found.begin(), found.end(), [](const Loop& a, const Loop& b) {
    if (a.from != b.from) return a.from < b.from;
    if (a.status != b.status) return a.status == Loop::Status::kWaiting;
    return a.match.planes * a.match.overlap > b.match.planes * b.match.overlap;
  });
  for (std::size_t i = 0; i < found.size(); ++i) {
    if (i == 0 || found[i].from != found[i - 1].from) loops_.push_back(found[i]);
  }
}

std::string LoopClosure::DriftRefusal(const Loop& loop) const {
  const SE3 predicted = anchors_[loop.from].Inverse() * anchors_[loop.to];
  const PoseDifference off =
      DifferenceAt(places_[loop.to].image.middle(), predicted, loop.match.T_other_query);
  return off.Within(WithDrift(kSlack, options_, loop.way_m)) ? ""
                                                             : "farther off than odometry drifts";
}

void LoopClosure::Correct() {
  const AnchorGraph graph = this->graph();
  const AnchorGraphResult result = SolveAnchorGraph(graph, options_.graph);
  anchors_ = result.poses;
  corrected_ = corrected_ || result.good;
  std::vector<SE3> start;
  for (const Submap& submap : submaps_) start.push_back(submap.T_world_submap);
  cost_before_ = 0.0;
  cost_ = result.cost;
  std::size_t kept = 0;
  for (Loop& loop : loops_) {
    if (loop.status != Loop::Status::kAccepted) continue;
    const std::size_t i = kept++;
    loop.solved = result.kept[i];
    if (loop.solved) {
      cost_before_ += SquaredResidual(graph.loops[i], start);
    } else {
      loop.status = Loop::Status::kRefused;
      loop.reason = WhyLeftOut(result);
    }
  }
}

void AddToMap(const Submap& submap, const SE3& T_world_submap, VoxelMap* map) {
  AddLeaves(submap, submap.Leaves(), T_world_submap, map);
  map->Refresh();
  map->EvictToBudget();
}

void AddToMap(const std::vector<Submap>& submaps, const std::vector<SE3>& anchors, VoxelMap* map) {
  for (std::size_t i = 0; i < submaps.size(); ++i) AddToMap(submaps[i], anchors[i], map);
}

}  // namespace lamina
