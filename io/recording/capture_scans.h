// The sweeps of one sensor in a capture of its packets.
//
// Private to io/recording.
#pragma once

#include <string>
#include <vector>

#include "io/container/packet_capture.h"
#include "io/recording/scan_source.h"

namespace lamina {

// Whether `path` is a file that begins like a capture.
bool HoldsPackets(const std::string& path);

// A sweep begins where the sensor passes straight ahead; it is stamped when its first packet was
// captured. The file is read through once when it is opened. Data packets of Velodyne sensors are
// read (io/message/velodyne_packet.h); a sensor is named by its address and port, as by a topic.
class CaptureScans final : public ScanSource {
 public:
  // Throws InputError if there are no such packets, or, naming all, if those of several sensors.
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
  Scan Decode(std::size_t i, std::string* sensor) const;

  RandomFile file_;
  CaptureFormat format_;
  std::string source_;
  std::vector<Sweep> sweeps_;
  RecordingDescription described_;
};

}  // namespace lamina
