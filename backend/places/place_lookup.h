// Where a submap may lie in others, by their images from above alone (place_image.h).
//
//   1. Likeness of the polar magnitudes at the best angle: an upper bound in practice, microseconds
//      each. The most alike go on.
//   2. For the best angles of each, and their opposites: correlation of the turned image with the
//      other's over all shifts at once; the highest peak is the shift.
//
//     score = sum a b / (|a| |b|) at that angle and shift, in [0, 1]
//
// The height comes from the ground that both have seen. What is found here is a hypothesis; only
// registration of the submaps' planes tells (submap_registration.h).
#pragma once

#include <cstddef>
#include <vector>

#include "backend/places/place_image.h"

namespace lamina {

struct PlaceHypothesis {
  std::size_t other = 0;  // position in the list that was searched
  SE3 T_other_query;      // between the submaps' frames
  double score = 0.0;
};

// In the order of their scores, at most two of each other submap. Deterministic at any number of
// threads.
std::vector<PlaceHypothesis> LookUpPlace(const PlaceImage& query,
                                         const std::vector<const PlaceImage*>& others,
                                         const PlaceOptions& options);

}  // namespace lamina
