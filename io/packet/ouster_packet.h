// Data packets of Ouster's sensors OS0, OS1, OS2 (firmware 2.0 and later), and scans of them.
#pragma once

#include <cstddef>
#include <string_view>

#include "io/packet/ouster_metadata.h"
#include "io/packet/packet_sensor.h"

namespace lamina {

// The points of a sweep are in the sensor's frame (x forward). Without a return there is no point;
// of two returns of one pulse that are equal the second tells nothing.
class OusterSensor final : public PacketSensor {
 public:
  explicit OusterSensor(OusterMetadata metadata);

  std::size_t packet_bytes() const { return packet_bytes_; }
  // PlaceOf, of a packet of which only the first bytes are there: kHeadBytes are enough.
  static constexpr std::size_t kHeadBytes = 16;
  std::uint32_t PlaceInHead(std::string_view head) const;
  // Frames are counted by the sensor.
  std::optional<std::uint32_t> PlaceOf(std::string_view packet) const override;
  bool BeginsSweep(std::uint32_t before, std::uint32_t now) const override;
  std::unique_ptr<SweepDecoder> NewSweep() const override;
  const char* unit_of_times() const override { return "ns"; }

 private:
  const OusterMetadata metadata_;
  std::size_t packet_bytes_ = 0;
};

// Whether a packet is as long as one of such a sensor with 16, 32, 64 or 128 channels: without the
// metadata more cannot be said.
bool MayBeOusterPacket(std::string_view packet);

}  // namespace lamina
