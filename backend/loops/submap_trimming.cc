#include "backend/loops/submap_trimming.h"

#include <algorithm>
#include <cmath>
#include <set>

#include "core/base/angle.h"

namespace lamina {
namespace {

// Submaps before the newest whose loops may have made another dispensable only now: it is covered
// when the last keyframe of the visit has passed.
constexpr std::size_t kRecent = 3;
// A keyframe is near another within this share of a submap's length.
constexpr double kNearShare = 1.0 / 3.0;

// Submaps that a chain of two loops joins lie on one level only if they are nearer than storeys.
constexpr double kSameLevelM = 2.0;
// What turns by less sees the same, however narrow its view.
constexpr double kSameViewDeg = 15.0;

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
    if (i > 0 && Follows(map.submaps[i], map.submaps[i - 1])) all.insert(i - 1);
    if (i + 1 < map.submaps.size() && Follows(map.submaps[i + 1], map.submaps[i]))
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

// Whether each keyframe has one of the other submap where it is, turned the same way.
bool StandsWhere(std::size_t other, std::size_t submap, const TrimmingView& map) {
  const auto pose = [&](std::size_t of, const SubmapKeyframe& keyframe) {
    return map.anchors[of] * keyframe.T_submap_lidar;
  };
  const std::vector<SubmapKeyframe>&keyframes = map.submaps[submap].keyframes,
        &others = map.submaps[other].keyframes;
  return std::all_of(keyframes.begin(), keyframes.end(), [&](const SubmapKeyframe& keyframe) {
    const SE3 T = pose(submap, keyframe);
    return std::any_of(others.begin(), others.end(), [&](const SubmapKeyframe& theirs) {
      return AreClose(T, pose(other, theirs), kSameLevelM, Radians(kSameViewDeg));
    });
  });
}

// Submaps too near along the way for loops, of a sensor that turns on the spot: positions.
std::vector<std::size_t> StandingWith(std::size_t submap, const TrimmingView& map,
                                      double min_way_m) {
  std::vector<std::size_t> standing;
  for (std::size_t i = 0; i < map.submaps.size(); ++i) {
    if (i != submap && std::abs(map.ways_m[i] - map.ways_m[submap]) < min_way_m &&
        StandsWhere(i, submap, map))
      standing.push_back(i);
  }
  return standing;
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
  for (const std::size_t i : StandingWith(submap, map, options.min_way_m)) {
    if (i < submap && earlier == 0) *holder = i;
    ++(i < submap ? earlier : later);
  }
  return earlier >= options.kept_visits && later > 0;
}

}  // namespace

std::optional<DispensableSubmap> FindDispensable(const TrimmingView& map,
                                                 const LoopOptions& options) {
  const std::size_t size = map.submaps.size();
  std::set<std::size_t> candidates;
  if (size > 2) candidates.insert(size - 3);
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
