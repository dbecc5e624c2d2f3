#include "backend/localisation/place_search.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "core/base/angle.h"

namespace lamina {
namespace {

// Keyframes between two looks: of the first ones, and after kFirstLooks.
constexpr int kKeyframesFirst = 10, kKeyframesThen = 40;
constexpr std::int64_t kFirstLooks = 15;
// What the sensor must have moved on between two looks that agree, as a share of a submap's way.
constexpr double kMovedShare = 0.1;
// How far two looks may be apart, the earlier one followed in the map.
constexpr double kAgreeM = 0.4, kAgreeDeg = 3.0;
// A submap that is longer than this share of the largest is looked for by itself.
constexpr double kLongEnough = 0.5;
// Way that a query may have, times that of a submap: what a place shows is wider.
constexpr double kWayFactor = 1.3;

SubmapOptions Longer(SubmapOptions options) {
  options.length_m *= kWayFactor;
  return options;
}

}  // namespace

PlaceSearch::PlaceSearch(const LoopOptions& options, double leaf_size_m)
    : options_(Longer(options.submap)), builder_(options_, leaf_size_m) {}

void PlaceSearch::Add(const FinalKeyframe& keyframe) {
  if (auto submap = builder_.Add(keyframe)) complete_ = std::move(submap);
}

void PlaceSearch::CountKeyframe(const SE3& T_own_lidar) {
  ++keyframes_since_look_;
  newest_ = T_own_lidar.t;
}

bool PlaceSearch::HasMovedOnTo(const Eigen::Vector3d& sensor) const {
  return (sensor - sensor_).norm() >= kMovedShare * options_.length_m;
}

bool PlaceSearch::Due() const {
  // What was believed once is asked again as soon as that can say more.
  if (looks_ > 0 && reason_.empty()) return HasMovedOnTo(newest_);
  const int after = looks_ < kFirstLooks ? kKeyframesFirst : kKeyframesThen;
  return keyframes_since_look_ >= after;
}

Submap PlaceSearch::Gathered(const std::vector<FinalKeyframe>& window) const {
  SubmapBuilder builder = builder_;
  std::optional<Submap> complete = complete_;
  for (const FinalKeyframe& keyframe : window) {
    if (auto submap = builder.Add(keyframe)) complete = std::move(submap);
  }
  Submap current = builder.Current();
  if (complete && current.way_m < kLongEnough * options_.length_m) return std::move(*complete);
  return current;
}

PlaceSearch::Query PlaceSearch::BeginLook(std::vector<FinalKeyframe> window) {
  keyframes_since_look_ = 0;
  ++looks_;
  Submap gathered = Gathered(window);
  return {std::move(gathered), std::move(window)};
}

std::optional<FoundPlace> PlaceSearch::Look(const Query& query, const PlaceIndex& places,
                                            const PlaceSource& map) {
  const auto& [submap, window] = query;
  candidates_.clear();
  if (submap.keyframes.empty()) return std::nullopt;
  const SE3 T_submap_own = submap.T_world_submap.Inverse();
  const std::vector<Sighting> sightings = places.Find(submap, window, map);
  ambiguous_ = Repeats(sightings).value_or(ambiguous_);
  for (const Sighting& sighting : sightings) {
    candidates_.push_back({{sighting.piece, sighting.T_piece_submap * T_submap_own},
                           sighting.match,
                           sighting.met,
                           sighting.gone,
                           sighting.reason,
                           sighting.same_as_best});
  }
  reason_ = candidates_.front().reason;
  if (!reason_.empty()) return std::nullopt;
  const Eigen::Vector3d sensor = submap.T_world_submap * submap.keyframes.back().T_submap_lidar.t;
  FoundPlace found = candidates_.front().place;
  const std::optional<SE3> settled = places.RefinePose(found, window, map);
  if (!settled) {
    reason_ = "the last scans do not lie there";
    return std::nullopt;
  }
  found.T_piece_own = *settled;
  const bool agrees = Agrees(found, sensor, window, places, map);
  if (agrees && HasMovedOnTo(sensor)) return found;
  // A look from where the last one was says nothing new.
  if (!agrees) sensor_ = sensor;
  last_ = {found};
  for (const PlaceCandidate& candidate : candidates_) {
    if (!candidate.same_as_best) continue;
    if (const auto T = places.RefinePose(candidate.place, window, map))
      last_.push_back({candidate.place.piece, *T});
  }
  last_keyframe_ = window.empty() ? -1 : window.back().id;
  return std::nullopt;
}

bool PlaceSearch::Agrees(const FoundPlace& found, const Eigen::Vector3d& sensor,
                         const std::vector<FinalKeyframe>& window, const PlaceIndex& places,
                         const PlaceSource& map) const {
  const auto last = std::find_if(last_.begin(), last_.end(), [&](const FoundPlace& place) {
    return place.piece == found.piece;
  });
  if (last == last_.end()) return false;
  std::vector<FinalKeyframe> since;
  std::copy_if(window.begin(), window.end(), std::back_inserter(since),
               [&](const FinalKeyframe& keyframe) { return keyframe.id > last_keyframe_; });
  const std::optional<SE3> followed = places.Follow(*last, since, map);
  return followed && (found.T_piece_own * sensor - *followed * sensor).norm() <= kAgreeM &&
         RotationAngle(found.T_piece_own, *followed) <= Radians(kAgreeDeg);
}

void PlaceSearch::Archive(StateArchive& a) {
  bool complete = complete_.has_value();
  a(&builder_, &complete, &keyframes_since_look_, &newest_, &looks_, &ambiguous_, &reason_, &last_,
    &last_keyframe_, &sensor_);
  if (a.reading()) complete_ = complete ? std::make_optional<Submap>() : std::nullopt;
  if (complete) a(&*complete_);
}

}  // namespace lamina
