// Data packets of Velodyne sensors: 12 blocks of 100 bytes (flag 0xEEFF, azimuth in 0.01 deg, 32
// returns of distance and intensity), the time in us of the hour, return mode and sensor.
//
// A sensor is a VelodyneModel, in a file of its own; to add one, write such a file and give it a
// line in the table of velodyne_packet.cc.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "core/geometry/scan.h"

namespace lamina {

// One laser, in the order of the packet.
struct VelodyneBeam {
  double elevation_deg = 0.0;
  double azimuth_deg = 0.0;  // added to the block's
  double up_m = 0.0;         // of its origin
};

struct VelodyneModel {
  const char* name = "";
  std::uint8_t id = 0;  // in the last byte of the packet
  double range_unit_m = 0.002;
  const VelodyneBeam* beams = nullptr;
  std::size_t beam_count = 0;  // 16: two firings a block; 32: one
  std::size_t at_once = 1;     // lasers that fire together
  double laser_us = 0.0;       // from these to the next
  double firing_us = 0.0;      // from a firing of all lasers to the next
};

extern const VelodyneModel kVlp16;
extern const VelodyneModel kVlp32c;
extern const VelodyneModel kHdl32e;

inline constexpr std::size_t kVelodynePacketBytes = 1206;

// The azimuth of its first block in 0.01 deg; 36000 if it is no such packet.
std::uint32_t VelodyneAzimuth(std::string_view packet);

// Packets of one sweep, in order.
class VelodyneDecoder {
 public:
  // Adds the points of a packet to the scan, with times from the first packet on. `stamp_ns` is
  // when the packet was received: its own time is taken instead where both agree within 50 ms.
  // Throws InputError, which begins with `name`, for a packet of an unknown sensor; what is no data
  // packet is passed over.
  void Add(std::string_view packet, StampNs stamp_ns, const std::string& name, Scan* scan);

  // "VLP-16, dual return"; empty before the first packet.
  std::string Describe() const;

 private:
  double StartOf(std::string_view packet, StampNs stamp_ns);

  const VelodyneModel* model_ = nullptr;
  bool dual_ = false;
  StampNs first_stamp_ns_ = 0;
  std::uint32_t first_us_ = 0;
};

}  // namespace lamina
