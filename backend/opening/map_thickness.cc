#include "backend/opening/map_thickness.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "core/base/median.h"

namespace lamina {

MapThickness MeasureThickness(const VoxelMap& map, int min_frames) {
  std::vector<float> variances;
  map.ForEachSurface(min_frames, [&](const Surfel& s) { variances.push_back(s.eigenvalues(2)); });
  MapThickness thickness;
  thickness.planes = variances.size();
  if (variances.empty()) return thickness;
  const auto quarter = variances.begin() + static_cast<std::ptrdiff_t>(variances.size() / 4);
  std::nth_element(variances.begin(), quarter, variances.end());
  thickness.thin_m = std::sqrt(std::max(0.0, static_cast<double>(*quarter)));
  thickness.median_m = std::sqrt(std::max(0.0, static_cast<double>(UpperMedian(&variances))));
  return thickness;
}

}  // namespace lamina
