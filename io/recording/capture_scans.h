// The sweeps of one sensor in a capture of its packets.
//
// Private to io/recording.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "io/packet/capture_sensors.h"
#include "io/packet/packet_capture.h"
#include "io/recording/scan_source.h"

namespace lamina {

// Whether `path` is a file that begins like a capture.
bool HoldsPackets(const std::string& path);

// A sweep is stamped when its first packet was captured. The file is read through once when it is
// opened. Which sensors' packets are read is for io/packet/capture_sensors.h; a sensor is named
// by its address and port, as by a topic.
class CaptureScans final : public ScanSource {
 public:
  // Throws InputError if there are no such packets or they lack what tells how to read them, or,
  // naming all, if there are those of several sensors.
  CaptureScans(const std::string& path, const ScanSourceOptions& options);

  std::size_t size() const override { return sweeps_.size(); }
  std::string Name(std::size_t i) const override;
  StampNs Stamp(std::size_t i) const override { return sweeps_.at(i).stamp_ns; }
  Scan Read(std::size_t i) const override;
  PointTimeField PointTimes(std::size_t i) const override;
  RecordingDescription Describe() const override { return described_; }

 private:
  struct Sweep {
    std::uint64_t place = 0;  // of its first packet
    std::uint32_t packets = 0;
    StampNs stamp_ns = 0;
  };
  struct Source {
    const PacketSensor* sensor = nullptr;
    std::vector<Sweep> sweeps;
    std::uint64_t packets = 0;
    std::uint32_t place = 0;
  };
  std::map<std::string, Source> FindSources();
  void CheckFirstPackets() const;
  Scan Decode(std::size_t i, std::string* described) const;

  RandomFile file_;
  const CaptureSensors sensors_;
  CaptureFormat format_;
  const PacketSensor* sensor_ = nullptr;
  std::string source_;
  std::vector<Sweep> sweeps_;
  RecordingDescription described_;
};

}  // namespace lamina
