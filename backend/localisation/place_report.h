// What came of a look for a piece, of which nothing is known, in a finished map (place_search.h).
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "backend/submaps/submap_registration.h"
#include "core/geometry/se3.h"
#include "core/geometry/state_archive.h"

namespace lamina {

struct FoundPlace {
  std::int64_t piece = 0;  // of the map
  SE3 T_piece_own;         // from the frame of the sensor's own piece to that of the map's

  void Archive(StateArchive& a) { a(&piece, &T_piece_own); }
};

// Where the piece might be as well.
struct PlaceCandidate {
  FoundPlace place;
  SubmapMatch match;
  double met = 0.0, gone = 0.0;  // place_evidence.h
  std::string reason;            // why it is not to be believed; empty if it is
  bool same_as_best = false;     // sighting.h
};

struct PlaceReport {
  std::size_t scan = 0;    // the newest
  std::int64_t piece = 0;  // of its own
  std::string reason;      // why nothing was believed; empty if it was
  std::optional<FoundPlace> found;
  // All poses that were registered in full, the likeliest first.
  std::vector<PlaceCandidate> candidates;
};

using OnPlaceReport = std::function<void(const PlaceReport&)>;

}  // namespace lamina
