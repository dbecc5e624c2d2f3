// The sensors whose packets a capture may hold, with what they say of themselves in files beside
// it.
#pragma once

#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "io/packet/packet_sensor.h"

namespace lamina {

// For a capture NAME.pcap:
//
//   Ouster           metadata: NAME.json, NAME_0.json or metadata.json
//   Velodyne 64E     calibration: NAME.xml or db.xml
class CaptureSensors {
 public:
  // Files that cannot be read count as missing until their packets are found.
  explicit CaptureSensors(const std::string& path);

  // Whose packet it is; null if it is of none that is known.
  const PacketSensor* Find(std::string_view packet) const;
  // Why packets of which none was taken cannot be read; empty if nothing is known of them.
  std::string WhyNot(std::string_view packet) const;

 private:
  std::vector<std::unique_ptr<PacketSensor>> sensors_;
  std::string metadata_;  // what is wrong with them
};

}  // namespace lamina
