#include "backend/loops/join_candidates.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <set>
#include <utility>

#include "backend/loops/loop_agreement.h"
#include "core/base/angle.h"

namespace lamina {
namespace {

// What a single loop must show.
constexpr double kSingleOverlap = 0.85, kSingleStructure = 0.7, kSingleFactor = 2.0;
// Of its planes, how many must hold the direction that the fewest hold: of a tunnel with niches
// 0.2 % did 217 m from the right place, of rooms and streets 5 % and more.
constexpr double kSingleFacingShare = 0.01;
// What is turned by more differs by half a turn.
constexpr double kHalfTurnRad = 0.5 * M_PI;

}  // namespace

SE3 JoinCandidates::BetweenParts(const Loop& loop, std::size_t a) const {
  const std::vector<SE3>& poses = pieces_.graph.poses;
  const SE3 T = poses[loop.from] * loop.match.T_other_query * poses[loop.to].Inverse();
  return PartOf(loop.from) == a ? T : T.Inverse();
}

bool JoinCandidates::Agree(const Loop& x, const Loop& y, std::size_t a) const {
  const auto side = [&](const Loop& loop, bool first) {
    return (PartOf(loop.from) == a) == first ? loop.from : loop.to;
  };
  const double way = submaps_.WayBetween(side(x, true), side(y, true)) +
                     submaps_.WayBetween(side(x, false), side(y, false));
  // Joins must agree however long the way between them is: their submaps' poses are corrected ones.
  constexpr double kMostAgreeDeg = 5.0;
  PoseDifference most = AgreementBound(options_, way);
  most.m = std::min(kMostAgreeM, most.m);
  most.rad = std::min(Radians(kMostAgreeDeg), most.rad);
  const SE3 T_x = BetweenParts(x, a), T_y = BetweenParts(y, a);
  const std::size_t b_side = side(x, false);
  return DifferenceAt(pieces_.graph.poses[b_side] * Middle(b_side), T_x, T_y).Within(most);
}

std::size_t JoinCandidates::SizeOf(const JoinGroup& group) const {
  std::set<std::size_t> in_a, in_b;
  for (const std::size_t i : group.members) {
    const Loop& loop = pieces_.loops[i];
    const bool forward = PartOf(loop.from) == group.a;
    in_a.insert(forward ? loop.from : loop.to);
    in_b.insert(forward ? loop.to : loop.from);
  }
  return std::min(in_a.size(), in_b.size());
}

// Around each candidate those that agree with it; the largest first, each candidate in one alone.
std::vector<JoinGroup> JoinCandidates::GroupsOf(std::size_t a, std::size_t b) const {
  std::vector<std::size_t> open;
  for (std::size_t i = 0; i < pieces_.loops.size(); ++i) {
    const Loop& loop = pieces_.loops[i];
    const std::size_t from = PartOf(loop.from), to = PartOf(loop.to);
    if (loop.status == Loop::Status::kWaiting && std::min(from, to) == a && std::max(from, to) == b)
      open.push_back(i);
  }
  std::vector<JoinGroup> groups;
  while (!open.empty()) {
    JoinGroup best;
    double best_weight = 0.0;
    for (const std::size_t seed : open) {
      JoinGroup group{a, b, seed, {}, 0, ""};
      double weight = 0.0;
      for (const std::size_t i : open) {
        const Loop& loop = pieces_.loops[i];
        if (i != seed && !Agree(pieces_.loops[seed], loop, a)) continue;
        group.members.push_back(i);
        weight += loop.match.planes * loop.match.overlap;
      }
      group.size = SizeOf(group);
      if (std::make_pair(group.size, weight) <= std::make_pair(best.size, best_weight)) continue;
      best_weight = weight;
      best = std::move(group);
    }
    std::vector<std::size_t> left;
    std::set_difference(open.begin(), open.end(), best.members.begin(), best.members.end(),
                        std::back_inserter(left));
    open = std::move(left);
    groups.push_back(std::move(best));
  }
  return groups;
}

// Of a group in which one submap stands alone.
std::string JoinCandidates::SingleRefusal(const JoinGroup& group) const {
  for (const std::size_t i : group.members) {
    const SubmapMatch& match = pieces_.loops[i].match;
    const VerificationOptions& least = options_.verification;
    if (match.overlap >= kSingleOverlap && match.structure >= kSingleStructure &&
        match.planes >= kSingleFactor * least.min_planes &&
        match.facing >=
            std::max(kSingleFactor * least.min_facing, kSingleFacingShare * match.planes))
      return "";
  }
  return "no other loop agrees";
}

bool JoinCandidates::IsRival(const Loop& other, const Loop& loop, std::size_t a,
                             double least_turn_rad) const {
  return other.from == loop.from && other.to == loop.to && other.status == Loop::Status::kWaiting &&
         RotationAngle(other.match.T_other_query, loop.match.T_other_query) >= least_turn_rad &&
         !Agree(other, loop, a);
}

bool JoinCandidates::FitsBetterElsewhere(const JoinGroup& group, double least_turn_rad) const {
  const auto better = [&](const Loop& loop) {
    return std::any_of(pieces_.loops.begin(), pieces_.loops.end(), [&](const Loop& other) {
      return FitsClearlyBetter(other.match, loop.match) &&
             IsRival(other, loop, group.a, least_turn_rad);
    });
  };
  return std::any_of(group.members.begin(), group.members.end(),
                     [&](std::size_t i) { return better(pieces_.loops[i]); });
}

bool JoinCandidates::FitsTurnedAsWell(const JoinGroup& group) const {
  int as_well = 0, worse = 0;
  for (const std::size_t i : group.members) {
    const Loop& loop = pieces_.loops[i];
    bool turned = false, decided = true;
    for (const Loop& other : pieces_.loops) {
      if (!IsRival(other, loop, group.a, kHalfTurnRad)) continue;
      turned = true;
      decided = decided && LacksFarLess(loop.match, other.match);
    }
    if (turned) ++(decided ? worse : as_well);
  }
  return as_well > worse;
}

std::optional<JoinGroup> JoinCandidates::BestOf(std::size_t a, std::size_t b) {
  std::vector<JoinGroup> groups = GroupsOf(a, b);
  constexpr char kBetterElsewhere[] = "another pose fits better";
  // What is right but for half a turn is no rival to what is right.
  const auto turned = [&](const JoinGroup& group) {
    if (!FitsBetterElsewhere(group, kHalfTurnRad)) return false;
    for (const std::size_t i : group.members) pieces_.loops[i].reason = kBetterElsewhere;
    return true;
  };
  groups.erase(std::remove_if(groups.begin(), groups.end(), turned), groups.end());
  if (groups.empty()) return std::nullopt;
  JoinGroup& best = groups.front();
  if (best.size < 2) best.refusal = SingleRefusal(best);
  if (FitsBetterElsewhere(best, 0.0)) best.refusal = kBetterElsewhere;
  // Of a single loop any other is a rival.
  const std::size_t least = best.size < 2 ? 1 : best.size / 2 + 1;
  if ((groups.size() > 1 && groups[1].size >= least) || FitsTurnedAsWell(best))
    best.refusal = "others fit as well";
  for (const std::size_t i : best.members) pieces_.loops[i].reason = best.refusal;
  return best;
}

}  // namespace lamina
