// The sweeps of one sensor in a capture of its packets.
//
// Private to io/recording.
#pragma once

#include <map>
#include <string>

#include "io/packet/capture_sensors.h"
#include "io/packet/packet_capture.h"
#include "io/recording/sweep_scans.h"

namespace lamina {

// Whether `path` is a file that begins like a capture.
bool HoldsPackets(const std::string& path);

// A sweep is stamped when its first packet was captured. The file is read through once when it is
// opened. Which sensors' packets are read is for io/packet/capture_sensors.h; a sensor is named
// by its address and port, as by a topic.
class CaptureScans final : public SweepScans {
 public:
  // Throws InputError if there are no such packets or they lack what tells how to read them, or,
  // naming all, if there are those of several sensors.
  CaptureScans(const std::string& path, const ScanSourceOptions& options);

 private:
  struct Source {
    const PacketSensor* sensor = nullptr;
    SweepFinder found;
  };
  std::map<std::string, Source> FindSources();
  void CheckFirstPackets() const;
  void ForEachPacket(const Sweep& sweep, const UsePacket& use) const override;
  const PacketSensor& sensor() const override { return *sensor_; }

  RandomFile file_;
  const CaptureSensors sensors_;
  CaptureFormat format_;
  const PacketSensor* sensor_ = nullptr;
  std::string source_;
};

}  // namespace lamina
