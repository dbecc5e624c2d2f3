// What an Ouster sensor says of itself in JSON: its beams, and how its packets are laid out. Either
// kind: flat (firmware 2.0 to 2.3), or in sections (from 2.4 on).
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "core/geometry/se3.h"

namespace lamina {

// Of the packets: see ouster_packet.cc.
enum class OusterProfile {
  kLegacy,
  kRng19Rfl8Sig16Nir16,
  kRng19Rfl8Sig16Nir16Dual,
  kRng15Rfl8Nir8,
  kRng15Rfl8Nir8Dual
};
const char* ToString(OusterProfile profile);  // as metadata name it

struct OusterMetadata {
  std::string product;  // "OS-1-128"
  OusterProfile profile = OusterProfile::kLegacy;
  std::size_t columns_per_frame = 1024;
  std::size_t columns_per_packet = 16;
  // Of each channel, in degrees.
  std::vector<double> altitude_deg, azimuth_deg;
  // From the axis of rotation to where the beams begin: along them, and up.
  double origin_m = 0.0, origin_up_m = 0.0;
  SE3 T_sensor_lidar;  // the sensor's x points forward, that of its lidar to the connector
};

// `name` begins errors. Throws InputError: no JSON, a field is missing, of a wrong length or size,
// or the profile is not known.
OusterMetadata ParseOusterMetadata(const std::string& text, const std::string& name);

}  // namespace lamina
