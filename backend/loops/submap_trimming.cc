#include "backend/loops/submap_trimming.h"

#include <algorithm>
#include <set>

namespace lamina {
namespace {

// Submaps before the newest whose loops may have made another dispensable only now: it is covered
// when the last keyframe of the visit has passed.
constexpr std::size_t kRecent = 3;
// A keyframe is near another within this share of a submap's length.
constexpr double kNearShare = 1.0 / 3.0;

// Submaps that a chain of two loops joins lie on one level only if they are nearer than storeys.
constexpr double kSameLevelM = 2.0;

// Of a submap by others: their positions, ascending.
struct Visit {
  std::vector<std::size_t> joined;  // by a loop with the submap
  std::vector<std::size_t> all;     // or with one that has a loop with it
};

std::set<std::size_t> JoinedTo(std::size_t submap, const std::vector<Loop>& loops) {
  std::set<std::size_t> joined;
  for (const Loop& loop : loops) {
    if (loop.status != Loop::Status::kAccepted || !loop.solved) continue;
    if (loop.from == submap) joined.insert(loop.to);
    if (loop.to == submap) joined.insert(loop.from);
  }
  return joined;
}

// In order of time.
std::vector<Visit> VisitsOf(std::size_t submap, const TrimmingView& map, double min_way_m) {
  const std::set<std::size_t> joined = JoinedTo(submap, map.loops);
  std::set<std::size_t> all = joined;
  for (const std::size_t partner : joined) {
    const std::set<std::size_t> further = JoinedTo(partner, map.loops);
    all.insert(further.begin(), further.end());
  }
  all.erase(submap);
  std::vector<Visit> visits;
  for (const std::size_t i : all) {
    const auto one_passage = [&](std::size_t before) {
      return (before < submap) == (i < submap) &&
             map.ways_m[i] - map.ways_m[before] < min_way_m + map.submaps[before].way_m;
    };
    if (visits.empty() || !one_passage(visits.back().all.back())) visits.emplace_back();
    visits.back().all.push_back(i);
    if (joined.count(i) > 0) visits.back().joined.push_back(i);
  }
  return visits;
}

// With the submaps right before and after them.
std::set<std::size_t> WithNeighbours(const std::vector<std::size_t>& submaps,
                                     const TrimmingView& map) {
  std::set<std::size_t> all(submaps.begin(), submaps.end());
  for (const std::size_t i : submaps) {
    if (i > 0 && map.submaps[i - 1].id + 1 == map.submaps[i].id) all.insert(i - 1);
    if (i + 1 < map.submaps.size() && map.submaps[i].id + 1 == map.submaps[i + 1].id)
      all.insert(i + 1);
  }
  return all;
}

bool Cover(const std::vector<std::size_t>& others, std::size_t submap, const TrimmingView& map,
           double near_m) {
  std::vector<Eigen::Vector3d> seen;
  for (const std::size_t i : WithNeighbours(others, map)) {
    if (i == submap) continue;
    for (const SubmapKeyframe& keyframe : map.submaps[i].keyframes)
      seen.push_back(map.anchors[i] * keyframe.T_submap_lidar.t);
  }
  const std::vector<SubmapKeyframe>& keyframes = map.submaps[submap].keyframes;
  return std::all_of(keyframes.begin(), keyframes.end(), [&](const SubmapKeyframe& keyframe) {
    const Eigen::Vector3d p = map.anchors[submap] * keyframe.T_submap_lidar.t;
    return std::any_of(seen.begin(), seen.end(), [&](const Eigen::Vector3d& q) {
      return (p - q).squaredNorm() <= near_m * near_m;
    });
  });
}

bool Dispensable(std::size_t submap, const TrimmingView& map, const LoopOptions& options,
                 std::size_t* holder) {
  const std::vector<Visit> visits = VisitsOf(submap, map, options.min_way_m);
  const double near_m = kNearShare * options.submap.length_m;
  int earlier = 0, later = 0;
  for (const Visit& visit : visits) {
    if (!Cover(visit.joined, submap, map, near_m) &&
        !Cover(visit.all, submap, map, std::min(near_m, kSameLevelM)))
      continue;
    const bool before = visit.all.front() < submap;
    if (before && earlier == 0) *holder = visit.all.front();
    ++(before ? earlier : later);
  }
  return earlier >= options.kept_visits && later > 0;
}

}  // namespace

std::optional<DispensableSubmap> FindDispensable(const TrimmingView& map,
                                                 const LoopOptions& options) {
  const std::size_t size = map.submaps.size();
  std::set<std::size_t> candidates;
  for (const Loop& loop : map.loops) {
    const bool recent = loop.to + kRecent >= size && loop.from + 2 < size;
    if (recent && loop.status == Loop::Status::kAccepted && loop.solved)
      candidates.insert(loop.from);
  }
  for (const std::size_t submap : candidates) {
    std::size_t holder = 0;
    if (Dispensable(submap, map, options, &holder)) return DispensableSubmap{submap, holder};
  }
  return std::nullopt;
}

}  // namespace lamina
