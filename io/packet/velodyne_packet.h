// Data packets of Velodyne sensors: 12 blocks of 100 bytes (flag 0xEEFF, azimuth in 0.01 deg, 32
// returns of distance and intensity), the time in us of the hour, return mode and sensor.
//
// A sensor is a VelodyneModel, in a file of its own; to add one, write such a file and give it a
// line in the table of velodyne_packet.cc.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "core/geometry/scan.h"
#include "io/packet/packet_sensor.h"
#include "io/packet/velodyne_hdl64e.h"

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
inline constexpr std::size_t kVelodyneBlocks = 12, kVelodyneReturns = 32;
inline constexpr std::uint16_t kVelodyneFlag = 0xEEFF;

// Parts of a packet of that size: of block b, and of return k in it.
struct VelodyneReturn {
  std::uint16_t distance = 0;
  std::uint8_t intensity = 0;
};
std::uint16_t VelodyneFlag(std::string_view packet, std::size_t b);
std::uint16_t VelodyneAzimuthOf(std::string_view packet, std::size_t b);  // 0.01 deg
VelodyneReturn VelodyneReturnAt(std::string_view packet, std::size_t b, std::size_t k);

// The azimuth of its first block in 0.01 deg; 36000 if it is no such packet.
std::uint32_t VelodyneAzimuth(std::string_view packet);

class VelodyneDecoder final : public SweepDecoder {
 public:
  // That of an HDL-64E, which must outlive it, or null.
  explicit VelodyneDecoder(const Hdl64eCalibration* calibration = nullptr)
      : calibration_(calibration) {}

  // The time in a packet is taken instead of `stamp_ns` where both agree within 50 ms. Throws
  // InputError for a packet of an unknown sensor, or of an HDL-64E without calibration.
  void Add(std::string_view packet, StampNs stamp_ns, const std::string& name, Scan* scan) override;
  std::string Describe() const override;

 private:
  double StartOf(std::string_view packet, StampNs stamp_ns);

  const Hdl64eCalibration* calibration_;
  const VelodyneModel* model_ = nullptr;
  bool any_ = false, hdl64e_ = false, dual_ = false;
  StampNs first_stamp_ns_ = 0;
  std::uint32_t first_us_ = 0;
};

// All of them, for captures. A sweep begins where the sensor passes straight ahead.
class VelodyneSensor final : public PacketSensor {
 public:
  explicit VelodyneSensor(std::optional<Hdl64eCalibration> calibration)
      : calibration_(calibration) {}

  std::optional<std::uint32_t> PlaceOf(std::string_view packet) const override;
  bool BeginsSweep(std::uint32_t before, std::uint32_t now) const override { return now < before; }
  std::unique_ptr<SweepDecoder> NewSweep() const override;
  const char* unit_of_times() const override { return "us"; }

 private:
  const std::optional<Hdl64eCalibration> calibration_;
};

}  // namespace lamina
