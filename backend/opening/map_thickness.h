// How thick the planes of a map are.
#pragma once

#include <cstddef>

#include "core/map/voxel_map.h"

namespace lamina {

struct MapThickness {
  std::size_t planes = 0;
  // sqrt(l3), over the planes; 0 without any. A quarter of them are thinner than thin_m: clutter
  // thickens many, beams that disagree all.
  double median_m = 0.0, thin_m = 0.0;
};

// Over the planes that at least min_frames frames have seen. Visits the whole map.
MapThickness MeasureThickness(const VoxelMap& map, int min_frames);

}  // namespace lamina
