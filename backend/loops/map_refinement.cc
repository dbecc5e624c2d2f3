#include "backend/loops/map_refinement.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <string>
#include <string_view>
#include <utility>

#include "backend/loops/loop_agreement.h"
#include "backend/places/submap_pairs.h"
#include "backend/places/submap_place.h"
#include "core/base/disjoint_sets.h"

namespace lamina {
namespace {

// Middles of submaps that are compared are at most so far apart, of the way of one; the nearest.
constexpr double kBesideShare = 0.7;
constexpr std::size_t kMostOverlapping = 6;
constexpr int kMostRounds = 6;
// Pairs that are registered between two reports of progress.
constexpr std::size_t kBatch = 64;

using Pair = std::pair<std::size_t, std::size_t>;

template <typename T>
std::string BytesOf(T* value) {
  StateArchive archive;
  archive(value);
  return archive.written();
}

class GraphRefiner {
 public:
  GraphRefiner(const std::vector<const Submap*>& submaps, const AnchorGraph& graph,
               const LoopOptions& options, const VoxelMapOptions& map,
               const ScanMatcherOptions& matcher, ResultJournal* journal)
      : submaps_(submaps), options_(options), map_(map), registration_(matcher), journal_(journal) {
    result_.graph = graph;
    for (const auto* edges : {&graph.odometry, &graph.loops}) {
      for (const AnchorEdge& edge : *edges) compared_.insert(std::minmax(edge.from, edge.to));
    }
    FindParts();
    Describe();
  }

  RefinedGraph Refine(const std::function<void(std::size_t, std::size_t)>& progress) {
    std::size_t done = 0;
    for (; result_.rounds < kMostRounds; ++result_.rounds) {
      const std::vector<SubmapPair> pairs = Overlapping();
      if (pairs.empty()) break;
      const std::size_t due = done + pairs.size();
      for (std::size_t begin = 0; begin < pairs.size(); begin += kBatch) {
        const std::size_t end = std::min(pairs.size(), begin + kBatch);
        Compare({pairs.begin() + static_cast<std::ptrdiff_t>(begin),
                 pairs.begin() + static_cast<std::ptrdiff_t>(end)});
        done += end - begin;
        if (progress) progress(done, due);
      }
      Solve();
    }
    return std::move(result_);
  }

 private:
  void FindParts();
  void Describe();
  std::vector<SubmapPair> Overlapping() const;
  void Compare(const std::vector<SubmapPair>& pairs);
  // Those of the journal, and the others registered.
  std::vector<SubmapMatch> MatchesOf(std::vector<SubmapPair> pairs);
  void Solve();
  Eigen::Vector3d Middle(std::size_t i) const { return images_[i].middle(); }

  const std::vector<const Submap*>& submaps_;
  const LoopOptions& options_;
  const VoxelMapOptions& map_;
  SubmapRegistration registration_;
  ResultJournal* journal_;  // may be null
  std::vector<PlaceImage> images_;
  std::vector<std::size_t> part_, chain_;  // chain_: those that odometry joins
  std::vector<double> way_;                // along the chain
  std::set<Pair> compared_;
  std::vector<std::size_t> loop_of_edge_;  // of the edges that were found here
  RefinedGraph result_;
};

void GraphRefiner::FindParts() {
  DisjointSets joined(submaps_.size());
  way_.assign(submaps_.size(), 0.0);
  for (const AnchorEdge& edge : result_.graph.odometry) {
    joined.Join(edge.from, edge.to);
    if (edge.to != edge.from + 1) continue;
    const Submap &from = *submaps_[edge.from], &to = *submaps_[edge.to];
    // What was trimmed between them was a way round.
    way_[edge.to] = way_[edge.from] + from.way_m + (Follows(to, from) ? 0.0 : options_.min_way_m);
  }
  chain_ = joined.All();
  for (const AnchorEdge& edge : result_.graph.loops) joined.Join(edge.from, edge.to);
  part_ = joined.All();
}

void GraphRefiner::Describe() {
  images_.reserve(submaps_.size());
  for (std::size_t i = 0; i < submaps_.size(); ++i) {
    const bool follows = i > 0 && chain_[i] == chain_[i - 1];
    images_.push_back(ImageOfSubmap(*submaps_[i], LeafPlanes(*submaps_[i]),
                                    follows ? submaps_[i - 1] : nullptr,
                                    follows ? &images_[i - 1] : nullptr, options_.place));
  }
}

std::vector<SubmapPair> GraphRefiner::Overlapping() const {
  const std::vector<SE3>& poses = result_.graph.poses;
  std::vector<Eigen::Vector3d> middles;
  for (std::size_t i = 0; i < poses.size(); ++i) middles.push_back(poses[i] * Middle(i));
  std::vector<SubmapPair> pairs;
  for (std::size_t to = 0; to < poses.size(); ++to) {
    std::vector<std::pair<double, std::size_t>> near;
    for (std::size_t from = 0; from < to; ++from) {
      if (part_[from] != part_[to]) continue;
      if (chain_[from] == chain_[to] &&
          way_[to] - way_[from] - submaps_[from]->way_m < options_.min_way_m)
        continue;
      const double distance = (middles[from] - middles[to]).norm();
      if (distance < kBesideShare * options_.submap.length_m) near.emplace_back(distance, from);
    }
    KeepNearest(kMostOverlapping, &near);
    for (const auto& [distance, from] : near) {
      if (compared_.count({from, to}) == 0)
        pairs.push_back({from, to, poses[from].Inverse() * poses[to], 0.0});
    }
  }
  return pairs;
}

std::vector<SubmapMatch> GraphRefiner::MatchesOf(std::vector<SubmapPair> pairs) {
  if (journal_ == nullptr) return RegisterPairs(submaps_, images_, pairs, registration_, map_, {});
  std::vector<SubmapMatch> matches(pairs.size());
  std::vector<std::string> keys;
  std::vector<std::size_t> open;
  std::vector<SubmapPair> open_pairs;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    keys.push_back(BytesOf(&pairs[i]));
    if (const auto known = journal_->Find(keys[i])) {
      StateArchive archive{std::string_view(*known)};
      archive(&matches[i]);
      continue;
    }
    open.push_back(i);
    open_pairs.push_back(pairs[i]);
  }
  if (open.empty()) return matches;
  std::vector<SubmapMatch> found =
      RegisterPairs(submaps_, images_, open_pairs, registration_, map_, {});
  for (std::size_t k = 0; k < open.size(); ++k) {
    journal_->Add(keys[open[k]], BytesOf(&found[k]));
    matches[open[k]] = found[k];
  }
  journal_->Sync();
  return matches;
}

void GraphRefiner::Compare(const std::vector<SubmapPair>& pairs) {
  const std::vector<SubmapMatch> matches = MatchesOf(pairs);
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    compared_.insert({pairs[i].from, pairs[i].to});
    Loop loop = LoopOf(pairs[i], matches[i], options_.verification);
    if (loop.reason.empty() && !IsWhereExpected(loop, pairs[i], images_[loop.to]))
      loop.reason = "not where the other loops have it";
    loop.status = loop.reason.empty() ? Loop::Status::kAccepted : Loop::Status::kRefused;
    if (loop.reason.empty()) {
      result_.graph.loops.push_back(EdgeOf(loop));
      result_.graph.kept_before.push_back(false);
      loop_of_edge_.push_back(result_.loops.size());
    }
    result_.loops.push_back(loop);
  }
}

void GraphRefiner::Solve() {
  AnchorGraph& graph = result_.graph;
  const AnchorGraphResult solved = SolveAnchorGraph(graph, options_.graph);
  graph.poses = solved.poses;
  // What was there before is first; what was found here follows in the order of its loops.
  const std::size_t before = graph.loops.size() - loop_of_edge_.size();
  std::vector<AnchorEdge> edges;
  std::vector<std::size_t> loops;
  for (std::size_t i = 0; i < graph.loops.size(); ++i) {
    if (i >= before) {
      Loop& loop = result_.loops[loop_of_edge_[i - before]];
      loop.solved = solved.kept[i];
      if (loop.solved) {
        loops.push_back(loop_of_edge_[i - before]);
      } else {
        loop.status = Loop::Status::kRefused;
        loop.reason = WhyLeftOut(solved);
      }
    }
    if (solved.kept[i]) edges.push_back(graph.loops[i]);
  }
  graph.loops = std::move(edges);
  graph.kept_before.assign(graph.loops.size(), true);
  loop_of_edge_ = std::move(loops);
}

}  // namespace

RefinedGraph RefineGraph(const std::vector<const Submap*>& submaps, const AnchorGraph& graph,
                         const LoopOptions& options, const VoxelMapOptions& map,
                         const ScanMatcherOptions& matcher,
                         const std::function<void(std::size_t, std::size_t)>& progress,
                         ResultJournal* journal) {
  CheckOptions(options, "loops");
  return GraphRefiner(submaps, graph, options, map, matcher, journal).Refine(progress);
}

}  // namespace lamina
