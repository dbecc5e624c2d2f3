#include "tools/run/thick_planes.h"

#include <fmt/format.h>

namespace lamina {

std::string ThickPlanesWarning(const MapThickness& map, const MappingOptions& options) {
  // Generated drives, a quarter of the planes thinner than: 2 mm with an exact sensor, 7 mm with
  // 2 cm of noise, 10 / 15 / 24 mm with beams off by 0.125 / 0.25 / 0.5 degrees; 13 mm on real
  // recordings. The noise floor of matching is 20 mm.
  constexpr double kAllowedShare = 0.7;
  constexpr std::size_t kLeastPlanes = 200;
  const double allowed_m = kAllowedShare * options.mapper.map.noise_floor_m;
  if (map.planes < kLeastPlanes || map.thin_m <= allowed_m) return "";
  return fmt::format(
      "planes are thicker than the sensor's noise allows: three quarters of them more than "
      "{:.0f} mm, and {:.0f} mm are expected (0.7 map.noise_floor_m). Beams whose "
      "angles or ranges are off do that, and make the poses drift: `lamina calibrate` finds "
      "preparation.vertical_correction_deg and preparation.range_offset_m, with --beams those "
      "of each beam",
      1e3 * map.thin_m, 1e3 * allowed_m);
}

}  // namespace lamina
