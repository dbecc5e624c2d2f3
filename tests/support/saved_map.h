// The roots of a map as they are saved.
#pragma once

#include <string>

#include "core/map/voxel_map.h"

namespace lamina {

// Saved `piece` bytes at a time.
inline std::string Saved(VoxelMap* map, std::size_t piece = 10000) {
  map->BeginSnapshot();
  std::string all, records;
  bool more = true;
  while (more) {
    more = map->ContinueSnapshot(piece, &records);
    all += records;
  }
  return all;
}

}  // namespace lamina
