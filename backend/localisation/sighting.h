// A pose at which a submap seems to lie in the map, and the gates that it is believed by.
//
// The gates are stricter than those of loops, which know where to expect the sensor. What
// contradicts a pose is what one of submap and map has standing and the other has not,
//
//     contradiction = (1 - met) + gone        shares, place_evidence.h
//
// and of two poses the one with less is the likelier. All functions here are pure.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "backend/submaps/submap_registration.h"
#include "core/geometry/se3.h"

namespace lamina {

struct Sighting {
  std::size_t place = 0;  // that it was registered against
  std::int64_t piece = 0;
  SE3 T_piece_submap;
  SubmapMatch match;             // T_other_query is of the place
  double score = 0.0;            // of the images
  double met = 0.0, gone = 0.0;  // place_evidence.h
  std::string reason;            // why it is not to be believed; empty if it is
  // Beside the best: of another piece, which lies in the best one's piece so that both poses are
  // one.
  bool same_as_best = false;
};

// Of what stands in a query, and of what stands in the map, at least and at most.
inline constexpr double kMet = 0.9, kMostGone = 0.1;

bool SamePose(const SE3& a, const SE3& b, double most_m, double most_deg);
// The same of poses after registration.
bool SamePose(const SE3& a, const SE3& b);

double Contradiction(const Sighting& sighting);

// Why a pose is not to be believed; empty if it is. `least`: of loops.
std::string StrictRefusal(const Sighting& sighting, const VerificationOptions& least);

// Whether another pose contradicts the map about as little as the best one and is not the same pose
// of the same piece.
bool IsRival(const Sighting& other, const Sighting& best);

// Whether all rivals of the first one are the same as it. No two poses of one piece are.
bool NoRival(const std::vector<Sighting>& sightings);

// Whether one of the pieces has two poses among the first one and its rivals: the surroundings
// repeat there. Nothing if the first one has not what stands here, so that they say nothing.
std::optional<bool> Repeats(const std::vector<Sighting>& sightings);

}  // namespace lamina
