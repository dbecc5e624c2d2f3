// The sweeps of a sensor whose packets are recorded, as scans: what captures of packets and
// containers of messages that hold them have in common.
//
// Private to io/recording.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "io/packet/packet_sensor.h"
#include "io/recording/scan_source.h"

namespace lamina {

struct Sweep {
  StampNs stamp_ns = 0;       // of its first packet
  std::uint64_t place = 0;    // of that packet in the recording
  std::uint64_t last = 0;     // of the last one
  std::uint32_t packets = 0;  // of the sensor
};

// Sweeps by their packets, in the order of the recording.
class SweepFinder {
 public:
  // Where the packet was measured and where it is: PacketSensor::PlaceOf, Sweep::place.
  void Add(const PacketSensor& sensor, std::uint32_t measured_at, std::uint64_t place,
           StampNs stamp_ns);
  std::vector<Sweep>& sweeps() { return sweeps_; }
  std::uint64_t packets() const { return packets_; }

 private:
  std::vector<Sweep> sweeps_;
  std::uint64_t packets_ = 0;
  std::uint32_t before_ = 0;
};

class SweepScans : public ScanSource {
 public:
  std::size_t size() const final { return sweeps_.size(); }
  std::string Name(std::size_t i) const final;
  StampNs Stamp(std::size_t i) const final { return sweeps_.at(i).stamp_ns; }
  Scan Read(std::size_t i) const final;
  PointTimeField PointTimes(std::size_t) const final;
  bool spins() const final { return true; }
  RecordingDescription Describe() const final { return described_; }

 protected:
  explicit SweepScans(std::string path) : path_(std::move(path)) {}

  using UsePacket = std::function<void(std::string_view packet, StampNs stamp_ns)>;
  // Calls use() with the packets of a sweep, as far as they can be read.
  virtual void ForEachPacket(const Sweep& sweep, const UsePacket& use) const = 0;
  virtual const PacketSensor& sensor() const = 0;

  const std::string& path() const { return path_; }
  // What the first sweep tells of the sensor, behind " of "; empty if it cannot be read.
  std::string OfSensor() const;

  std::vector<Sweep> sweeps_;
  RecordingDescription described_;

 private:
  Scan Decode(std::size_t i, std::string* described) const;

  const std::string path_;
};

}  // namespace lamina
