// Sensors that send packets: what a recording of packets asks of them.
//
// To read those of another sensor, write a file with a PacketSensor as in ouster_packet.cc and give
// it a line in io/packet/capture_sensors.cc.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "core/geometry/scan.h"

namespace lamina {

// Packets of one sweep, in order.
class SweepDecoder {
 public:
  virtual ~SweepDecoder() = default;
  // Adds the points of a packet to the scan, with times from the first packet on. `stamp_ns` is
  // when the packet was received. What is no data packet is passed over. Throws InputError, which
  // begins with `name`, for a packet that cannot be read.
  virtual void Add(std::string_view packet, StampNs stamp_ns, const std::string& name,
                   Scan* scan) = 0;
  // "VLP-16, dual return"; empty before the first packet.
  virtual std::string Describe() const = 0;
};

// Thread-safe.
class PacketSensor {
 public:
  virtual ~PacketSensor() = default;
  // Where in its turns the packet was measured, in a unit of the sensor's; nothing if it is no data
  // packet of such a sensor.
  virtual std::optional<std::uint32_t> PlaceOf(std::string_view packet) const = 0;
  // Whether a packet at `now`, behind one at `before`, begins another sweep.
  virtual bool BeginsSweep(std::uint32_t before, std::uint32_t now) const = 0;
  virtual std::unique_ptr<SweepDecoder> NewSweep() const = 0;
  // Of the times in its packets.
  virtual const char* unit_of_times() const = 0;
};

}  // namespace lamina
