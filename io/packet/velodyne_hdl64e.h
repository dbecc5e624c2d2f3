// HDL-64E (user's manual 63-HDL64ES2/S3): packets as those of its sisters, but each pair of blocks
// is one firing, of the upper (flag 0xEEFF) and the lower (0xDDFF) 32 lasers; and the lasers of
// each sensor have a calibration of their own, which comes with it as a file, db.xml.
#pragma once

#include <array>
#include <cstddef>
#include <string>
#include <string_view>

#include "core/geometry/scan.h"

namespace lamina {

struct Hdl64eLaser {
  double rotation_deg = 0.0, elevation_deg = 0.0;
  double range_m = 0.0;                     // added to what was measured, far away
  double range_x_m = 0.0, range_y_m = 0.0;  // at 2.4 m to the side and 1.93 m ahead
  double up_m = 0.0, aside_m = 0.0;         // where its beam begins
};

struct Hdl64eCalibration {
  static constexpr std::size_t kLasers = 64;
  std::array<Hdl64eLaser, kLasers> lasers;
  double range_unit_m = 0.002;
};

// db.xml. `name` begins errors. Throws InputError if a laser or one of its fields is missing, or
// not a finite number.
Hdl64eCalibration ParseHdl64eCalibration(const std::string& text, const std::string& name);

// Of a packet of 1206 bytes.
bool IsHdl64ePacket(std::string_view packet);

// Adds its points, which were measured from `start_s` on.
void AddHdl64ePacket(std::string_view packet, const Hdl64eCalibration& calibration, double start_s,
                     Scan* scan);

}  // namespace lamina
