#include "backend/localisation/place_index.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <map>
#include <utility>

#include "backend/localisation/assembled_places.h"
#include "backend/places/place_lookup.h"
#include "backend/places/submap_place.h"
#include "core/base/angle.h"
#include "core/base/parallel.h"
#include "core/base/thinning.h"

namespace lamina {
namespace {

// Poses that are one and the same before registration.
constexpr double kNearM = 4.0, kNearDeg = 15.0;
constexpr double kSettledM = 0.1, kSettledDeg = 0.5;
// Of a pose that is looked at again, the one or the other.
constexpr double kLeastOverlap = 0.5, kLeastMet = 0.8;
// Other levels that are tried: how far up and down, at least so far, at most so many, where so much
// less is met than at the best pose, before registration.
constexpr double kLevelsM = 15.0, kNextLevelM = 1.5, kLevelMet = 0.3;
constexpr std::size_t kMostLevels = 6;
// Keyframes that settle where the sensor is now; what they, and single ones, must show.
constexpr std::size_t kSettledBy = 5;
constexpr double kLastFit = 0.7, kLastOverlap = 0.6;
// What the sensor's own piece may be bent by from one keyframe to the next.
constexpr double kStepM = 0.5, kStepDeg = 8.0;
// Hypotheses of one pose that are registered: places overlap.
constexpr int kEachPose = 2;
// Registrations, times those of a loop.
constexpr int kRegistrationsFactor = 3;
// Of what an image reaches, a place holds so much: what is farther a sensor there sees thinly.
constexpr double kRadiusShare = 0.9, kSpacingShare = 0.25;

double RadiusM(const LoopOptions& options) {
  return kRadiusShare * PlaceImage::kRadius * options.place.cell_size_m;
}

// What is so near to a sensor the nearest place holds as well, wherever between two of them it is.
double HeldM(const LoopOptions& options) {
  return RadiusM(options) - PlaceIndex::SpacingM(options);
}

// What lies within a radius of the middle of its way.
Submap Around(const Submap& submap, double radius_m) {
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  for (const SubmapKeyframe& keyframe : submap.keyframes)
    middle += keyframe.T_submap_lidar.t / static_cast<double>(submap.keyframes.size());
  Submap around = submap;
  around.leaves.clear();
  std::copy_if(submap.leaves.begin(), submap.leaves.end(), std::back_inserter(around.leaves),
               [&](const SubmapLeaf& leaf) {
                 return (submap.Cluster(leaf).mean - middle).norm() <= radius_m;
               });
  return around;
}

// Every n-th leaf.
Submap Thinned(const Submap& place) {
  constexpr std::size_t kEnough = 8000;
  Submap some = place;
  some.leaves.clear();
  const std::size_t stride = StrideToAtLeast(place.leaves.size(), kEnough);
  for (std::size_t i = 0; i < place.leaves.size(); i += stride)
    some.leaves.push_back(place.leaves[i]);
  return some;
}

}  // namespace

double PlaceIndex::SpacingM(const LoopOptions& options) { return kSpacingShare * RadiusM(options); }

PlaceIndex::PlaceIndex(const LoopOptions& options, const ScanMatcherOptions& matcher,
                       std::vector<MapPlace> places, const PlaceSource& map)
    : options_(options), registration_(matcher), places_(std::move(places)) {
  CheckOptions(options, "loops");
  images_.reserve(places_.size());
  for (std::size_t i = 0; i < places_.size(); ++i) {
    const Submap submap = map.Around(places_[i], RadiusM(options));
    T_piece_place_.push_back(submap.T_world_submap);
    images_.push_back(ImageOfSubmap(submap, LeafPlanes(submap), nullptr, nullptr, options_.place));
    views_.push_back({&images_.back(), places_[i].piece, submap.T_world_submap, i});
  }
}

PlaceIndex::PlaceIndex(const LoopOptions& options, const ScanMatcherOptions& matcher,
                       const PlaceSource::Pieces& pieces, const VoxelMapOptions& map)
    : options_(options), registration_(matcher) {
  CheckOptions(options, "loops");
  for (const auto& [piece, closure] : pieces) {
    std::vector<Eigen::Vector3d> way;
    for (std::size_t i = 0; i < closure->submaps().size(); ++i) {
      const SE3& anchor = closure->anchors()[i];
      for (const SubmapKeyframe& keyframe : closure->submaps()[i].keyframes)
        way.push_back(anchor * keyframe.T_submap_lidar.t);
      views_.push_back({&closure->image(i), piece, anchor, std::nullopt});
    }
    AddPlaces(piece, way, SpacingM(options), &places_);
  }
  for (const MapPlace& place : places_) T_piece_place_.push_back(PlaceFrame(place, map));
}

SE3 PlaceIndex::InPiece(const Hypothesis& hypothesis) const {
  return T_piece_place_[hypothesis.place] * hypothesis.T_place_submap;
}

PlaceIndex::Hypothesis PlaceIndex::HypothesisOf(const View& view, const SE3& T_view_submap,
                                                double score) const {
  if (view.place) return {*view.place, T_view_submap, score};
  const SE3 T_piece_submap = view.T_piece_view * T_view_submap;
  const std::size_t place = Nearest(view.piece, T_piece_submap.t);
  return {place, T_piece_place_[place].Inverse() * T_piece_submap, score};
}

std::vector<PlaceIndex::Hypothesis> PlaceIndex::Hypotheses(const PlaceImage& image) const {
  std::vector<const PlaceImage*> images;
  for (const View& view : views_) images.push_back(view.image);
  // Neighbouring places look alike: more of them are compared than of submaps.
  PlaceOptions options = options_.place;
  options.candidates *= 2;
  const std::size_t most = static_cast<std::size_t>(kRegistrationsFactor) *
                           static_cast<std::size_t>(options_.registrations);
  std::vector<Hypothesis> hypotheses;
  for (const PlaceHypothesis& found : LookUpPlace(image, images, options)) {
    if (hypotheses.size() == most) break;
    const Hypothesis next = HypothesisOf(views_[found.other], found.T_other_query, found.score);
    const auto alike = std::count_if(hypotheses.begin(), hypotheses.end(), [&](const auto& other) {
      return places_[other.place].piece == places_[next.place].piece &&
             SamePose(InPiece(other), InPiece(next), kNearM, kNearDeg);
    });
    if (alike < kEachPose) hypotheses.push_back(next);
  }
  return hypotheses;
}

std::vector<Sighting> PlaceIndex::Register(const SubmapQuery& query,
                                           const std::vector<Hypothesis>& hypotheses, bool coarse,
                                           AssembledPlaces* places) const {
  std::map<std::size_t, std::vector<std::size_t>> by_place;
  for (std::size_t i = 0; i < hypotheses.size(); ++i) by_place[hypotheses[i].place].push_back(i);
  std::vector<std::pair<const Submap*, const std::vector<std::size_t>*>> targets;
  for (const auto& [place, members] : by_place) targets.emplace_back(&places->At(place), &members);
  std::vector<Sighting> sightings(hypotheses.size());
  ParallelChunks(targets.size(), 1, [&](std::size_t t, std::size_t) {
    const SubmapTarget target(*targets[t].first, places->map().options());
    const OccupiedLeaves leaves(*targets[t].first);
    for (const std::size_t i : *targets[t].second) {
      const Hypothesis& hypothesis = hypotheses[i];
      Sighting& sighting = sightings[i];
      sighting.place = hypothesis.place;
      sighting.piece = places_[hypothesis.place].piece;
      sighting.score = hypothesis.score;
      sighting.match = registration_.Register(query, target, hypothesis.T_place_submap, coarse);
      sighting.T_piece_submap = T_piece_place_[hypothesis.place] * sighting.match.T_other_query;
      sighting.met = leaves.Met(query.upright, sighting.match.T_other_query);
    }
  });
  return sightings;
}

void PlaceIndex::Judge(const SubmapQuery& query, const SightLines& sight, const SE3& T_own_query,
                       AssembledPlaces* places, std::vector<Sighting>* sightings) const {
  std::map<std::size_t, std::vector<Sighting*>> by_place;
  for (Sighting& sighting : *sightings) by_place[sighting.place].push_back(&sighting);
  std::vector<std::pair<const Submap*, const std::vector<Sighting*>*>> groups;
  for (const auto& [place, members] : by_place) groups.emplace_back(&places->At(place), &members);
  ParallelChunks(groups.size(), 1, [&](std::size_t g, std::size_t) {
    const Submap some = Thinned(*groups[g].first);
    const std::vector<LeafPlane> planes = LeafPlanes(some);
    for (Sighting* const sighting : *groups[g].second) {
      const SE3& T_place_query = sighting->match.T_other_query;
      const auto upright = UprightLeaves(some, planes, T_place_query.q * query.up);
      sighting->gone = sight.Look(upright, T_own_query * T_place_query.Inverse()).GoneShare();
      sighting->reason = StrictRefusal(*sighting, options_.verification);
    }
  });
  std::stable_sort(sightings->begin(), sightings->end(), [](const Sighting& a, const Sighting& b) {
    if (a.match.met_planes != b.match.met_planes) return a.match.met_planes;
    return Contradiction(a) < Contradiction(b);
  });
}

std::vector<PlaceIndex::Hypothesis> PlaceIndex::OnOtherLevels(const SubmapQuery& query,
                                                              const Sighting& best,
                                                              AssembledPlaces* places) const {
  const Submap& place = places->At(best.place);
  const OccupiedLeaves leaves(place);
  const SE3& T_place_query = best.match.T_other_query;
  const Eigen::Vector3d up = T_place_query.q * query.up;
  const double step_m = 0.5 * place.leaf_size_m;
  const int steps = static_cast<int>(kLevelsM / step_m);
  const auto shifted = [&](int k) {
    return SE3(T_place_query.q, T_place_query.t + k * step_m * up);
  };
  std::vector<double> met;
  for (int k = -steps; k <= steps; ++k) met.push_back(leaves.Met(query.upright, shifted(k)));
  std::vector<std::pair<double, int>> peaks;
  for (int k = 1 - steps; k < steps; ++k) {
    const double here = met[static_cast<std::size_t>(k + steps)];
    if (std::abs(k) * step_m < kNextLevelM || here < best.met - kLevelMet) continue;
    if (here >= met[static_cast<std::size_t>(k + steps - 1)] &&
        here > met[static_cast<std::size_t>(k + steps + 1)])
      peaks.emplace_back(-here, k);
  }
  std::sort(peaks.begin(), peaks.end());
  if (peaks.size() > kMostLevels) peaks.resize(kMostLevels);
  std::vector<Hypothesis> levels;
  for (const auto& [value, k] : peaks) levels.push_back({best.place, shifted(k), best.score});
  return levels;
}

std::size_t PlaceIndex::Nearest(std::int64_t piece, const Eigen::Vector3d& at) const {
  std::size_t nearest = places_.size();
  double least = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < places_.size(); ++i) {
    const double distance = (places_[i].at - at).norm();
    if (places_[i].piece != piece || distance >= least) continue;
    least = distance;
    nearest = i;
  }
  return nearest;
}

std::vector<PlaceIndex::Hypothesis> PlaceIndex::OfNearest(const std::vector<Sighting>& sightings,
                                                          const Eigen::Vector3d& middle) const {
  std::vector<Hypothesis> nearest;
  for (const Sighting& sighting : sightings) {
    if (!sighting.match.met_planes) continue;
    if (sighting.match.overlap < kLeastOverlap && sighting.met < kLeastMet) continue;
    Hypothesis next{Nearest(sighting.piece, sighting.T_piece_submap * middle), SE3(),
                    sighting.score};
    next.T_place_submap = T_piece_place_[next.place].Inverse() * sighting.T_piece_submap;
    const bool known = std::any_of(nearest.begin(), nearest.end(), [&](const Hypothesis& other) {
      return other.place == next.place &&
             SamePose(other.T_place_submap, next.T_place_submap, kSettledM, kSettledDeg);
    });
    if (!known) nearest.push_back(next);
  }
  return nearest;
}

std::vector<Sighting> PlaceIndex::Find(const Submap& whole, const std::vector<FinalKeyframe>& last,
                                       const PlaceSource& map) const {
  AssembledPlaces places(places_, RadiusM(options_), map);
  const Submap submap = Around(whole, HeldM(options_));
  std::vector<LeafPlane> planes = LeafPlanes(submap);
  const PlaceImage image = ImageOfSubmap(submap, planes, nullptr, nullptr, options_.place);
  const SubmapQuery query = QueryOfSubmap(submap, std::move(planes), image);
  std::vector<Sighting> sightings = Register(query, Hypotheses(image), true, &places);
  sightings = Register(query, OfNearest(sightings, image.middle()), false, &places);
  const SightLines sight(last, submap.leaf_size_m);
  Judge(query, sight, submap.T_world_submap, &places, &sightings);
  if (!sightings.empty()) {
    // Storeys are seldom apart in images from above.
    std::vector<Sighting> levels =
        Register(query, OnOtherLevels(query, sightings.front(), &places), true, &places);
    sightings.insert(sightings.end(), levels.begin(), levels.end());
    Judge(query, sight, submap.T_world_submap, &places, &sightings);
  } else {
    sightings.emplace_back();
    sightings.front().reason = "nothing in the map is like it";
  }
  Sighting& best = sightings.front();
  if (!best.reason.empty()) return sightings;
  for (std::size_t i = 1; i < sightings.size(); ++i) {
    Sighting& other = sightings[i];
    if (IsRival(other, best))
      other.same_as_best = AreOnePlace(other, best, query.up, image.middle(), &places);
  }
  if (!NoRival(sightings)) {
    best.reason = "others fit as well";
  } else if (map.Ambiguous(best.piece)) {
    best.reason = "what is there fits elsewhere as well";
  }
  return sightings;
}

bool PlaceIndex::AreOnePlace(const Sighting& a, const Sighting& b, const Eigen::Vector3d& up,
                             const Eigen::Vector3d& middle, AssembledPlaces* places) const {
  if (!places->map().MayBeOne(a.piece, b.piece)) return false;
  const auto around = [&](const Sighting& sighting) {
    const std::size_t place = Nearest(sighting.piece, sighting.T_piece_submap * middle);
    return std::make_pair(place, Around(places->At(place), HeldM(options_)));
  };
  auto [place_a, submap_a] = around(a);
  auto [place_b, submap_b] = around(b);
  const bool a_is_less = submap_a.leaves.size() < submap_b.leaves.size();
  const Sighting &less = a_is_less ? a : b, &more = a_is_less ? b : a;
  const Submap& submap = a_is_less ? submap_a : submap_b;
  const std::size_t place_less = a_is_less ? place_a : place_b;
  const std::size_t place_more = a_is_less ? place_b : place_a;

  const SE3 T_more_less = more.T_piece_submap * less.T_piece_submap.Inverse();
  const SE3& T_less_place = T_piece_place_[place_less];
  const SubmapQuery query = MakeQuery(submap, LeafPlanes(submap),
                                      T_less_place.q.conjugate() * less.T_piece_submap.q * up);
  std::vector<Sighting> found = Register(
      query, {{place_more, T_piece_place_[place_more].Inverse() * T_more_less * T_less_place, 0.0}},
      false, places);
  FinalKeyframe seen;
  seen.T_world_lidar = submap.keyframes.front().T_submap_lidar;
  for (const SubmapLeaf& leaf : submap.leaves) seen.clusters.push_back(submap.Cluster(leaf));
  Judge(query, SightLines({seen}, submap.leaf_size_m), SE3(), places, &found);
  const SE3 T_again = found.front().T_piece_submap * T_less_place.Inverse();
  return found.front().reason.empty() &&
         SamePose(T_again * less.T_piece_submap, more.T_piece_submap);
}

PlaceIndex::Nearby PlaceIndex::NearbyOf(std::int64_t piece, const Eigen::Vector3d& at,
                                        AssembledPlaces* places) const {
  const std::size_t place = Nearest(piece, at);
  const Submap& submap = places->At(place);
  return {place, SubmapTarget(submap, places->map().options()), OccupiedLeaves(submap)};
}

std::optional<SE3> PlaceIndex::Lie(const std::vector<FinalKeyframe>& keyframes,
                                   const SE3& T_piece_own, const Nearby& nearby,
                                   bool coarse) const {
  const SE3& T_own_lidar = keyframes.back().T_world_lidar;
  const SE3 T_lidar_own = T_own_lidar.Inverse();
  std::vector<PointCluster> clusters;
  std::vector<Eigen::Vector3f> points;
  for (const FinalKeyframe& keyframe : keyframes) {
    for (const PointCluster& in_own : keyframe.clusters) {
      if (in_own.Empty() || (in_own.mean - T_own_lidar.t).norm() > HeldM(options_)) continue;
      clusters.push_back(in_own.Moved(T_lidar_own));
      points.push_back(clusters.back().mean.cast<float>());
    }
  }
  const SE3 T_piece_lidar = T_piece_own * T_own_lidar;
  const SE3& T_piece_place = T_piece_place_[nearby.place];
  const MatchResult match = registration_.Descend(clusters, nearby.target,
                                                  T_piece_place.Inverse() * T_piece_lidar, coarse);
  if (match.status == MatchResult::Status::kTooFewMatches || match.fit() < kLastFit ||
      match.overlap() < kLastOverlap || nearby.leaves.Met(points, match.T_world_lidar) < kMet)
    return std::nullopt;
  const SE3 T = T_piece_place * match.T_world_lidar;
  const bool near = coarse ? SamePose(T, T_piece_lidar, kNearM, kNearDeg)
                           : SamePose(T, T_piece_lidar, kStepM, kStepDeg);
  if (!near) return std::nullopt;
  return T * T_lidar_own;
}

std::optional<SE3> PlaceIndex::RefinePose(const FoundPlace& found,
                                          const std::vector<FinalKeyframe>& last,
                                          const PlaceSource& map) const {
  if (last.empty()) return found.T_piece_own;
  const SE3 T_piece_last = found.T_piece_own * last.back().T_world_lidar;
  AssembledPlaces places(places_, RadiusM(options_), map);
  const Nearby nearby = NearbyOf(found.piece, T_piece_last.t, &places);
  const std::size_t first = last.size() - std::min(last.size(), kSettledBy);
  const std::vector<FinalKeyframe> some(last.begin() + static_cast<std::ptrdiff_t>(first),
                                        last.end());
  const std::optional<SE3> settled = Lie(some, found.T_piece_own, nearby, true);
  return settled ? Lie({last.back()}, *settled, nearby, true) : std::nullopt;
}

std::optional<SE3> PlaceIndex::Follow(const FoundPlace& found,
                                      const std::vector<FinalKeyframe>& since,
                                      const PlaceSource& map) const {
  std::optional<SE3> T_piece_own = found.T_piece_own;
  AssembledPlaces places(places_, RadiusM(options_), map);
  std::optional<Nearby> nearby;
  for (std::size_t i = 0; i < since.size() && T_piece_own; ++i) {
    const Eigen::Vector3d at = *T_piece_own * since[i].T_world_lidar.t;
    if (!nearby || nearby->place != Nearest(found.piece, at))
      nearby.emplace(NearbyOf(found.piece, at, &places));
    T_piece_own = Lie({since[i]}, *T_piece_own, *nearby, false);
  }
  return T_piece_own;
}

}  // namespace lamina
