#include "backend/localisation/place_index.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <map>
#include <utility>

#include "backend/submaps/place_lookup.h"
#include "backend/submaps/submap_place.h"
#include "core/base/parallel.h"

namespace lamina {
namespace {

// What a submap must show beyond the gates of loops.
constexpr double kOverlap = 0.85, kStructure = 0.75, kFactor = 1.5;
// Poses that are one and the same; before registration, and after.
constexpr double kNearM = 4.0, kNearDeg = 15.0, kSameM = 0.7, kSameDeg = 3.0;
constexpr double kSettledM = 0.1, kSettledDeg = 0.5;
// Of a pose that is looked at again.
constexpr double kLeastOverlap = 0.5;
// Hypotheses of one pose that are registered: places overlap.
constexpr int kEachPose = 2;
// Registrations, times those of a loop.
constexpr int kRegistrationsFactor = 3;
// What contradicts a rival, of what contradicts the best: as a factor, and more. A pose so near
// that the descent should have come from one to the other must be as good.
constexpr double kRivalFactor = 2.5, kRivalMore = 0.04;
constexpr double kBesideM = 2.5, kBesideDeg = 10.0, kBesideFactor = 1.3, kBesideMore = 0.02;
// Of what an image reaches, a place holds so much: what is farther a sensor there sees thinly.
constexpr double kRadiusShare = 0.9, kSpacingShare = 0.25;

double RadiusM(const LoopOptions& options) {
  return kRadiusShare * PlaceImage::kRadius * options.place.cell_size_m;
}

bool Same(const SE3& a, const SE3& b, double most_m, double most_deg) {
  return (a.t - b.t).norm() <= most_m && RotationAngle(a, b) <= most_deg * M_PI / 180.0;
}

// What the map should show at a pose and does not, as shares.
double Contradiction(const SubmapMatch& match) {
  return (1.0 - match.overlap) + (1.0 - match.structure);
}

bool IsRival(const Sighting& other, const Sighting& best) {
  if (!other.reason.empty()) return false;
  const auto same = [&](double most_m, double most_deg) {
    return other.piece == best.piece &&
           Same(other.T_piece_submap, best.T_piece_submap, most_m, most_deg);
  };
  if (same(kSameM, kSameDeg)) return false;
  const bool beside = same(kBesideM, kBesideDeg);
  const double least = Contradiction(best.match);
  return Contradiction(other.match) <= std::max((beside ? kBesideFactor : kRivalFactor) * least,
                                                least + (beside ? kBesideMore : kRivalMore));
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

std::string StrictRefusal(const SubmapMatch& match, const VerificationOptions& least) {
  VerificationOptions strict = least;
  strict.min_planes = static_cast<int>(kFactor * least.min_planes);
  strict.min_facing *= kFactor;
  strict.min_overlap = std::max(least.min_overlap, kOverlap);
  strict.min_structure = std::max(least.min_structure, kStructure);
  return Refusal(match, strict);
}

}  // namespace

double PlaceIndex::SpacingM(const LoopOptions& options) { return kSpacingShare * RadiusM(options); }

PlaceIndex::PlaceIndex(const LoopOptions& options, const ScanMatcherOptions& matcher,
                       std::vector<MapPlace> places, const VoxelMap& map)
    : options_(options), registration_(matcher), places_(std::move(places)) {
  CheckOptions(options, "loops");
  images_.reserve(places_.size());
  for (std::size_t i = 0; i < places_.size(); ++i) {
    const Submap submap = At(i, map);
    T_piece_place_.push_back(submap.T_world_submap);
    images_.push_back(ImageOfSubmap(submap, LeafPlanes(submap), nullptr, nullptr, options_.place));
  }
}

Submap PlaceIndex::At(std::size_t place, const VoxelMap& map) const {
  return SubmapAround(places_[place], RadiusM(options_), map);
}

SE3 PlaceIndex::InPiece(const Hypothesis& hypothesis) const {
  return T_piece_place_[hypothesis.place] * hypothesis.T_place_submap;
}

std::vector<PlaceIndex::Hypothesis> PlaceIndex::Hypotheses(const PlaceImage& image) const {
  std::vector<const PlaceImage*> images;
  for (const PlaceImage& other : images_) images.push_back(&other);
  // Neighbouring places look alike: more of them are compared than of submaps.
  PlaceOptions options = options_.place;
  options.candidates *= 2;
  const std::size_t most = static_cast<std::size_t>(kRegistrationsFactor) *
                           static_cast<std::size_t>(options_.registrations);
  std::vector<Hypothesis> hypotheses;
  for (const PlaceHypothesis& found : LookUpPlace(image, images, options)) {
    if (hypotheses.size() == most) break;
    const Hypothesis next{found.other, found.T_other_query, found.score};
    const auto alike = std::count_if(hypotheses.begin(), hypotheses.end(), [&](const auto& other) {
      return places_[other.place].piece == places_[next.place].piece &&
             Same(InPiece(other), InPiece(next), kNearM, kNearDeg);
    });
    if (alike < kEachPose) hypotheses.push_back(next);
  }
  return hypotheses;
}

std::vector<Sighting> PlaceIndex::Register(const SubmapQuery& query,
                                           const std::vector<Hypothesis>& hypotheses, bool coarse,
                                           const VoxelMap& map) const {
  std::map<std::size_t, std::vector<std::size_t>> by_place;
  for (std::size_t i = 0; i < hypotheses.size(); ++i) by_place[hypotheses[i].place].push_back(i);
  std::vector<std::pair<Submap, const std::vector<std::size_t>*>> targets;
  for (const auto& [place, members] : by_place) targets.emplace_back(At(place, map), &members);
  std::vector<Sighting> sightings(hypotheses.size());
  ParallelChunks(targets.size(), 1, [&](std::size_t t, std::size_t) {
    const SubmapTarget target(targets[t].first, map.options());
    for (const std::size_t i : *targets[t].second) {
      const Hypothesis& hypothesis = hypotheses[i];
      Sighting& sighting = sightings[i];
      sighting.piece = places_[hypothesis.place].piece;
      sighting.score = hypothesis.score;
      sighting.match = registration_.Register(query, target, hypothesis.T_place_submap, coarse);
      sighting.T_piece_submap = T_piece_place_[hypothesis.place] * sighting.match.T_other_query;
      sighting.reason = Refusal(sighting.match, options_.verification);
    }
  });
  return sightings;
}

std::vector<PlaceIndex::Hypothesis> PlaceIndex::OfNearest(const std::vector<Sighting>& sightings,
                                                          const Eigen::Vector3d& middle) const {
  std::vector<Hypothesis> nearest;
  for (const Sighting& sighting : sightings) {
    if (!sighting.match.converged || sighting.match.overlap < kLeastOverlap) continue;
    const Eigen::Vector3d at = sighting.T_piece_submap * middle;
    Hypothesis next{places_.size(), SE3(), sighting.score};
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < places_.size(); ++i) {
      const double distance = (places_[i].at - at).norm();
      if (places_[i].piece != sighting.piece || distance >= least) continue;
      least = distance;
      next.place = i;
    }
    next.T_place_submap = T_piece_place_[next.place].Inverse() * sighting.T_piece_submap;
    const bool known = std::any_of(nearest.begin(), nearest.end(), [&](const Hypothesis& other) {
      return other.place == next.place &&
             Same(other.T_place_submap, next.T_place_submap, kSettledM, kSettledDeg);
    });
    if (!known) nearest.push_back(next);
  }
  return nearest;
}

Sighting PlaceIndex::Find(const Submap& whole, const VoxelMap& map) const {
  // What the nearest place holds as well, wherever between two of them the sensor is.
  const Submap submap = Around(whole, RadiusM(options_) - SpacingM(options_));
  std::vector<LeafPlane> planes = LeafPlanes(submap);
  const PlaceImage image = ImageOfSubmap(submap, planes, nullptr, nullptr, options_.place);
  const SubmapQuery query = QueryOfSubmap(submap, std::move(planes), image);
  std::vector<Sighting> sightings = Register(query, Hypotheses(image), true, map);
  sightings = Register(query, OfNearest(sightings, image.T_level_submap.Inverse().t), false, map);
  std::stable_sort(sightings.begin(), sightings.end(), [](const Sighting& a, const Sighting& b) {
    if (a.reason.empty() != b.reason.empty()) return a.reason.empty();
    return Contradiction(a.match) < Contradiction(b.match);
  });
  Sighting best;
  best.reason = "nothing in the map is like it";
  if (sightings.empty()) return best;
  best = sightings.front();
  if (!best.reason.empty()) return best;
  best.reason = StrictRefusal(best.match, options_.verification);
  if (std::any_of(sightings.begin() + 1, sightings.end(),
                  [&](const Sighting& other) { return IsRival(other, best); }))
    best.reason = "others fit as well";
  return best;
}

}  // namespace lamina
