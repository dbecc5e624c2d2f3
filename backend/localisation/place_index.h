// All places of a finished map, and which of them a submap shows that nothing is known of.
//
// Nothing tells where to look, so what repeats must be told apart, and a place that the map does
// not have must not be found in it. A submap is believed to lie at a pose if
//
//     looked up   the place looks alike (place_lookup.h): hypotheses, a few for each pose
//     registered  the submap's planes agree with the map's (submap_registration.h) by gates that
//                 are stricter than those of loops, which know where to expect the sensor
//     compared    what stands in one stands in the other, as far as it would show
//                 (place_evidence.h)
//     no rival    no pose elsewhere, also not on another level of the same place, contradicts the
//                 map about as little. A pose in another piece is not elsewhere if the two pieces
//                 are one place by it: what one has around there lies in the other, by the same
//                 gates, so that both poses are the same. Where storeys or houses repeat, what one
//                 has lies in several places of the other, and such a piece tells nothing: it stays
//                 a rival, and nothing is believed to lie in it
//
// What is believed once may still be an alias: PlaceSearch asks again after more of the way.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "backend/localisation/map_places.h"
#include "backend/localisation/place_evidence.h"
#include "backend/localisation/place_report.h"
#include "backend/localisation/sighting.h"
#include "backend/loops/loop_options.h"
#include "backend/places/place_image.h"
#include "backend/submaps/submap_registration.h"
#include "frontend/matching/scan_matcher.h"

namespace lamina {

class AssembledPlaces;

// Immutable; thread-safe.
class PlaceIndex {
 public:
  // Describes the places, each out of the map as it is now. Throws OptionError.
  PlaceIndex(const LoopOptions& options, const ScanMatcherOptions& matcher,
             std::vector<MapPlace> places, const PlaceSource& map);
  // The same of pieces as their own loops have left them: their submaps' images, which are there
  // already, are what hypotheses are found by, and must outlive it.
  PlaceIndex(const LoopOptions& options, const ScanMatcherOptions& matcher,
             const PlaceSource::Pieces& pieces, const VoxelMapOptions& map);

  // So near to one another that each place of a way is seen well from one of them.
  static double SpacingM(const LoopOptions& options);

  // Poses of a submap whose anchor is upright within options.place.max_tilt_deg, the most likely
  // first, each with what speaks against it, and that one also with its rivals. `last`: keyframes
  // in the frame of the submap's anchor that see what is around now. Never empty. `map`: as it was
  // described, whatever other pieces it has got since. Deterministic at any number of threads.
  std::vector<Sighting> Find(const Submap& submap, const std::vector<FinalKeyframe>& last,
                             const PlaceSource& map) const;

  // A place that was found, by the newest of the `last` keyframes and then the newest alone: what
  // the sensor's own piece is bent by does not matter to it. Nothing if they do not lie there.
  std::optional<SE3> RefinePose(const FoundPlace& found, const std::vector<FinalKeyframe>& last,
                                const PlaceSource& map) const;

  // A place where the sensor was, taken on over the keyframes since, each of which is registered by
  // itself: T_piece_own for the newest. Nothing if one of them does not lie there.
  std::optional<SE3> Follow(const FoundPlace& found, const std::vector<FinalKeyframe>& since,
                            const PlaceSource& map) const;

  const std::vector<MapPlace>& places() const { return places_; }

 private:
  struct Hypothesis {
    std::size_t place = 0;
    SE3 T_place_submap;
    double score = 0.0;
  };
  std::size_t Nearest(std::int64_t piece, const Eigen::Vector3d& at) const;
  SE3 InPiece(const Hypothesis& hypothesis) const;
  // The same poses, each of the place that is nearest to it, and once.
  std::vector<Hypothesis> OfNearest(const std::vector<Sighting>& sightings,
                                    const Eigen::Vector3d& middle) const;
  // The same pose on other levels of the place that the best one was registered against, where
  // much of the query is met.
  std::vector<Hypothesis> OnOtherLevels(const SubmapQuery& query, const Sighting& best,
                                        AssembledPlaces* places) const;
  // What the map has and the sensor does not see, the reason of each, and their order.
  void Judge(const SubmapQuery& query, const SightLines& sight, const SE3& T_own_query,
             AssembledPlaces* places, std::vector<Sighting>* sightings) const;
  // Whether two poses of a submap in two pieces are the same: what the piece that has less has
  // around lies in the other, as both say. `up`, `middle`: of the submap, in its frame.
  bool AreOnePlace(const Sighting& a, const Sighting& b, const Eigen::Vector3d& up,
                   const Eigen::Vector3d& middle, AssembledPlaces* places) const;
  std::vector<Sighting> Register(const SubmapQuery& query,
                                 const std::vector<Hypothesis>& hypotheses, bool coarse,
                                 AssembledPlaces* places) const;
  std::vector<Hypothesis> Hypotheses(const PlaceImage& image) const;
  // The place nearest to a point, for single scans to be compared with; and T_piece_own by which
  // these keyframes lie in it, near the one given. Nothing if they do not.
  struct Nearby {
    std::size_t place = 0;
    SubmapTarget target;
    OccupiedLeaves leaves;
  };
  Nearby NearbyOf(std::int64_t piece, const Eigen::Vector3d& at, AssembledPlaces* places) const;
  std::optional<SE3> Lie(const std::vector<FinalKeyframe>& keyframes, const SE3& T_piece_own,
                         const Nearby& nearby, bool coarse) const;

  // What looks alike is found by.
  struct View {
    const PlaceImage* image = nullptr;
    std::int64_t piece = 0;
    SE3 T_piece_view;                  // the frame of the image's submap
    std::optional<std::size_t> place;  // whose image it is
  };
  Hypothesis HypothesisOf(const View& view, const SE3& T_view_submap, double score) const;

  LoopOptions options_;
  SubmapRegistration registration_;
  std::vector<MapPlace> places_;
  std::vector<SE3> T_piece_place_;
  std::vector<PlaceImage> images_;  // of places
  std::vector<View> views_;
};

}  // namespace lamina
