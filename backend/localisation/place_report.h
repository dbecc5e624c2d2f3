// What came of a look for a piece, of which nothing is known, in a finished map (place_search.h).
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "core/geometry/se3.h"

namespace lamina {

struct FoundPlace {
  std::int64_t piece = 0;  // of the map
  SE3 T_piece_own;         // from the frame of the sensor's own piece to that of the map's
};

struct PlaceReport {
  std::size_t scan = 0;    // the newest
  std::int64_t piece = 0;  // of its own
  std::string reason;      // why nothing was believed; empty if it was
  std::optional<FoundPlace> found;
};

using OnPlaceReport = std::function<void(const PlaceReport&)>;

}  // namespace lamina
