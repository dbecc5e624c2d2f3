#include "backend/loops/piece_joining.h"

#include <algorithm>
#include <limits>
#include <optional>
#include <set>
#include <utility>

#include "backend/loops/join_candidates.h"
#include "backend/loops/loop_agreement.h"
#include "backend/loops/piece_submaps.h"
#include "backend/places/submap_pairs.h"

namespace lamina {
namespace {

// Submaps whose middles are so close under a join have seen the same.
constexpr double kBesideM = 20.0;
constexpr std::size_t kBesideEach = 2;
// How far around its loops a join is looked at before it is solved again.
constexpr double kReachM = 60.0;
constexpr int kRounds = 20;
// Where submaps lie beside one another, contradicting ones as a share of those that agree.
constexpr double kMostContradicting = 0.34;

class PieceJoiner {
 public:
  PieceJoiner(const std::vector<MapPiece>& pieces, const LoopOptions& options,
              const VoxelMapOptions& map, const ScanMatcherOptions& matcher,
              const WorkSharing& sharing)
      : pieces_(pieces),
        options_(options),
        map_(map),
        registration_(matcher),
        sharing_(sharing),
        submaps_(pieces, options.place) {
    AddPieces();
  }

  JoinedPieces Join() {
    if (pieces_.size() > 1) FindCandidates();
    while (JoinNext()) {
    }
    for (Loop& loop : result_.loops) {
      if (loop.status == Loop::Status::kWaiting && loop.reason.empty())
        loop.reason = "no other loop agrees";
    }
    AnchorGraph& graph = result_.graph;
    for (std::size_t i = kept_.size(); i-- > 0;) {
      if (!kept_[i]) graph.loops.erase(graph.loops.begin() + static_cast<std::ptrdiff_t>(i));
    }
    graph.kept_before.assign(graph.loops.size(), true);
    std::stable_sort(result_.loops.begin(), result_.loops.end(), [](const Loop& x, const Loop& y) {
      return std::make_pair(x.to, x.from) < std::make_pair(y.to, y.from);
    });
    return std::move(result_);
  }

 private:
  void AddPieces();
  void FindCandidates();
  // Of these pairs, registered; returns one for each.
  std::vector<Loop> AddCandidates(const std::vector<SubmapPair>& pairs);
  SubmapPair TurnedRound(const Loop& loop) const;

  std::size_t PartOf(std::size_t submap) const { return candidates_.PartOf(submap); }
  Eigen::Vector3d Middle(std::size_t submap) const { return candidates_.Middle(submap); }
  // In the order of the pairs.
  std::vector<SubmapMatch> Register(const std::vector<SubmapPair>& pairs) const {
    return RegisterPairs(submaps_.submaps(), submaps_.images(), pairs, registration_, map_,
                         sharing_);
  }
  bool JoinNext();
  using PairSet = std::set<std::pair<std::size_t, std::size_t>>;
  struct Evidence {
    std::size_t agreeing = 0, contradicting = 0;
  };
  // What speaks against it; empty if it is joined, otherwise the result is of no use.
  std::string TryJoin(const JoinGroup& group);
  std::vector<SubmapPair> Beside(const std::vector<bool>& joins, const PairSet& compared) const;
  void Compare(const std::vector<SubmapPair>& pairs, Evidence* evidence);
  // All pieces with the loops that are accepted; those that contradict the others go. Why it
  // failed; empty if it did not.
  std::string Solve();

  const std::vector<MapPiece>& pieces_;
  const LoopOptions& options_;
  const VoxelMapOptions& map_;
  SubmapRegistration registration_;
  const WorkSharing& sharing_;
  PieceSubmaps submaps_;
  std::size_t own_loops_ = 0;
  std::vector<bool> kept_;  // of the graph's loops, by the last solve
  JoinedPieces result_;
  JoinCandidates candidates_{submaps_, options_, &result_};
};

void PieceJoiner::AddPieces() {
  result_.first_submap = submaps_.first();
  for (std::size_t p = 0; p < pieces_.size(); ++p) {
    const MapPiece& piece = pieces_[p];
    const std::size_t first = submaps_.first()[p];
    result_.part.push_back(p);
    AnchorGraph& all = result_.graph;
    all.poses.insert(all.poses.end(), piece.graph.poses.begin(), piece.graph.poses.end());
    const auto add = [&](const std::vector<AnchorEdge>& from, std::vector<AnchorEdge>* to) {
      for (AnchorEdge edge : from) {
        edge.from += first;
        edge.to += first;
        to->push_back(edge);
      }
    };
    add(piece.graph.odometry, &all.odometry);
    add(piece.graph.loops, &all.loops);
  }
  own_loops_ = result_.graph.loops.size();
}

void PieceJoiner::FindCandidates() {
  const std::vector<SubmapPair> pairs = submaps_.LookUpAll(options_, sharing_);
  std::vector<SubmapPair> turned;
  for (const Loop& loop : AddCandidates(pairs)) {
    if (loop.status == Loop::Status::kWaiting) turned.push_back(TurnedRound(loop));
  }
  AddCandidates(turned);
}

// Half a turn about the upright through the middle of the way: rooms and streets look much the
// same then, and a look at images need not find both.
SubmapPair PieceJoiner::TurnedRound(const Loop& loop) const {
  const SE3& T_level_submap = submaps_.images()[loop.to].T_level_submap;
  const SE3 half(Eigen::Quaterniond(0.0, 0.0, 0.0, 1.0), Eigen::Vector3d::Zero());
  const SE3 turn = T_level_submap.Inverse() * half * T_level_submap;
  return {loop.from, loop.to, loop.match.T_other_query * turn, loop.score};
}

std::vector<Loop> PieceJoiner::AddCandidates(const std::vector<SubmapPair>& pairs) {
  const std::vector<SubmapMatch> matches = Register(pairs);
  std::vector<Loop> candidates;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const Loop loop = LoopOf(pairs[i], matches[i], options_.verification);
    candidates.push_back(loop);
    // Two starts that end in one place are one.
    const bool known =
        std::any_of(result_.loops.begin(), result_.loops.end(), [&](const Loop& other) {
          return other.from == loop.from && other.to == loop.to && other.status == loop.status &&
                 (loop.status == Loop::Status::kRefused ||
                  candidates_.Agree(other, loop, PartOf(loop.from)));
        });
    if (!known) result_.loops.push_back(loop);
  }
  return candidates;
}

bool PieceJoiner::JoinNext() {
  std::vector<std::size_t> parts;
  for (std::size_t p = 0; p < pieces_.size(); ++p) {
    if (result_.part[p] == p) parts.push_back(p);
  }
  std::vector<JoinGroup> groups;
  for (std::size_t i = 0; i < parts.size(); ++i) {
    for (std::size_t j = i + 1; j < parts.size(); ++j) {
      const std::optional<JoinGroup> best = candidates_.BestOf(parts[i], parts[j]);
      if (best && best->refusal.empty()) groups.push_back(*best);
    }
  }
  std::stable_sort(groups.begin(), groups.end(),
                   [](const JoinGroup& x, const JoinGroup& y) { return x.size > y.size; });
  for (const JoinGroup& group : groups) {
    JoinedPieces before = result_;
    std::vector<bool> kept = kept_;
    const std::string refusal = TryJoin(group);
    if (refusal.empty()) return true;
    result_ = std::move(before);
    kept_ = std::move(kept);
    for (const std::size_t i : group.members) {
      result_.loops[i].status = Loop::Status::kRefused;
      result_.loops[i].reason = refusal;
    }
  }
  return false;
}

// Submaps of the two sides of a join, not compared yet, that lie beside one another near its loops.
std::vector<SubmapPair> PieceJoiner::Beside(const std::vector<bool>& joins,
                                            const PairSet& compared) const {
  std::vector<double> to_loop(submaps_.size(), std::numeric_limits<double>::infinity());
  for (const Loop& loop : result_.loops) {
    if (loop.status != Loop::Status::kAccepted) continue;
    for (const std::size_t end : {loop.from, loop.to}) {
      for (std::size_t i = 0; i < submaps_.size(); ++i) {
        if (submaps_.piece_of(i) == submaps_.piece_of(end))
          to_loop[i] = std::min(to_loop[i], submaps_.WayBetween(i, end));
      }
    }
  }
  std::vector<SubmapPair> pairs;
  const std::vector<SE3>& poses = result_.graph.poses;
  for (std::size_t to = 0; to < submaps_.size(); ++to) {
    if (!joins[to]) continue;
    std::vector<std::pair<double, std::size_t>> near;
    for (std::size_t from = 0; from < submaps_.size(); ++from) {
      if (joins[from] || PartOf(from) != PartOf(to)) continue;
      if (std::min(to_loop[from], to_loop[to]) > kReachM) continue;
      const double distance = (poses[from] * Middle(from) - poses[to] * Middle(to)).norm();
      if (distance < kBesideM) near.emplace_back(distance, from);
    }
    KeepNearest(kBesideEach, &near);
    for (const auto& [distance, from] : near) {
      if (compared.count({from, to}) == 0)
        pairs.push_back({from, to, poses[from].Inverse() * poses[to], 0.0});
    }
  }
  return pairs;
}

// Registers them, and keeps those that agree; what came of it adds to *evidence.
void PieceJoiner::Compare(const std::vector<SubmapPair>& pairs, Evidence* evidence) {
  const std::vector<SubmapMatch> matches = Register(pairs);
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    Loop loop = LoopOf(pairs[i], matches[i], options_.verification);
    const bool expected = IsWhereExpected(loop, pairs[i], submaps_.images()[loop.to]);
    if (loop.status == Loop::Status::kWaiting && expected) {
      loop.status = Loop::Status::kAccepted;
      ++evidence->agreeing;
    } else if (expected && MayBeRight(loop.match, options_.verification)) {
      loop.status = Loop::Status::kRefused;
    } else if (loop.match.met_planes && loop.match.planes >= options_.verification.min_planes) {
      // What has few planes in common says nothing.
      ++evidence->contradicting;
      if (loop.reason.empty()) loop.reason = "not where the other loops have it";
      loop.status = Loop::Status::kRefused;
    }
    // In the place of what was found of this pair before.
    const auto same = [&](const Loop& other) {
      return other.status != Loop::Status::kAccepted &&
             std::minmax(other.from, other.to) == std::minmax(loop.from, loop.to);
    };
    result_.loops.erase(std::remove_if(result_.loops.begin(), result_.loops.end(), same),
                        result_.loops.end());
    result_.loops.push_back(loop);
  }
}

std::string PieceJoiner::Solve() {
  AnchorGraph& graph = result_.graph;
  graph.loops.resize(own_loops_);
  std::vector<Loop*> accepted;
  for (Loop& loop : result_.loops) {
    if (loop.status != Loop::Status::kAccepted) continue;
    accepted.push_back(&loop);
    graph.loops.push_back(EdgeOf(loop));
  }
  graph.kept_before.assign(graph.loops.size(), true);
  const AnchorGraphResult solved = SolveAnchorGraph(graph, options_.graph);
  if (!solved.good) return WhyLeftOut(solved);
  graph.poses = solved.poses;
  kept_ = solved.kept;
  for (std::size_t i = 0; i < accepted.size(); ++i) {
    accepted[i]->solved = kept_[own_loops_ + i];
    if (accepted[i]->solved) continue;
    accepted[i]->status = Loop::Status::kRefused;
    accepted[i]->reason = WhyLeftOut(solved);
  }
  return "";
}

std::string PieceJoiner::TryJoin(const JoinGroup& group) {
  // By the candidate that most agree with.
  const SE3 T_a_b = candidates_.BetweenParts(result_.loops[group.lead], group.a);
  std::vector<bool> joins(submaps_.size());
  for (std::size_t i = 0; i < submaps_.size(); ++i) {
    joins[i] = PartOf(i) == group.b;
    if (joins[i]) result_.graph.poses[i] = T_a_b * result_.graph.poses[i];
  }
  std::replace(result_.part.begin(), result_.part.end(), group.b, group.a);
  PairSet compared;
  for (const std::size_t i : group.members) {
    Loop& loop = result_.loops[i];
    loop.status = Loop::Status::kAccepted;
    compared.insert({loop.from, loop.to});
    compared.insert({loop.to, loop.from});
  }
  Evidence evidence;
  evidence.agreeing = group.size;
  if (std::string failure = Solve(); !failure.empty()) return failure;
  for (int round = 0; round < kRounds; ++round) {
    const std::vector<SubmapPair> pairs = Beside(joins, compared);
    if (pairs.empty()) break;
    for (const SubmapPair& pair : pairs) compared.insert({pair.from, pair.to});
    Compare(pairs, &evidence);
    if (std::string failure = Solve(); !failure.empty()) return failure;
  }
  const auto kept = std::count_if(result_.loops.begin(), result_.loops.end(), [&](const Loop& l) {
    return l.status == Loop::Status::kAccepted && joins[l.from] != joins[l.to];
  });
  const bool agrees = kept > 0 && static_cast<double>(evidence.contradicting) <=
                                      kMostContradicting * static_cast<double>(evidence.agreeing);
  return agrees ? "" : "what lies around does not agree";
}

}  // namespace

JoinedPieces JoinPieces(const std::vector<MapPiece>& pieces, const LoopOptions& options,
                        const VoxelMapOptions& map, const ScanMatcherOptions& matcher,
                        const WorkSharing& sharing) {
  CheckOptions(options, "loops");
  return PieceJoiner(pieces, options, map, matcher, sharing).Join();
}

}  // namespace lamina
