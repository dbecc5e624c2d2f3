// Places of a map as one look needs them: each is put together once, when it is first asked for.
//
// Not thread-safe.
//
// Private to backend/localisation.
#pragma once

#include <cstddef>
#include <map>
#include <vector>

#include "backend/localisation/map_places.h"
#include "backend/submaps/submap.h"

namespace lamina {

class AssembledPlaces {
 public:
  // All of these must outlive it.
  AssembledPlaces(const std::vector<MapPlace>& places, double radius_m, const PlaceSource& map)
      : places_(places), radius_m_(radius_m), map_(map) {}

  const PlaceSource& map() const { return map_; }
  // Stays where it is.
  const Submap& At(std::size_t place) {
    const auto found = assembled_.find(place);
    if (found != assembled_.end()) return found->second;
    return assembled_.emplace(place, map_.Around(places_[place], radius_m_)).first->second;
  }

 private:
  const std::vector<MapPlace>& places_;
  double radius_m_;
  const PlaceSource& map_;
  std::map<std::size_t, Submap> assembled_;
};

}  // namespace lamina
