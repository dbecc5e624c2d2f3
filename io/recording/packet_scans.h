// The sweeps of an Ouster sensor in a container of messages that hold its packets.
//
// Private to io/recording.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "io/container/message_container.h"
#include "io/message/packet_message.h"
#include "io/packet/ouster_packet.h"
#include "io/recording/scan_source.h"

namespace lamina {

// Whether the first messages of a topic hold packets with points, rather than of the IMU.
bool HoldsPointPackets(const MessageContainer& container, std::size_t topic);

// A sweep is stamped when its first packet was recorded. The head of each packet is read once when
// the source is opened. The sensor describes itself in a text on a topic called metadata, that of
// the same name space if there are several, or in a file: see io/packet/sensor_files.h.
class PacketScans final : public ScanSource {
 public:
  // Throws InputError if there are no such packets, or nothing tells how to read them.
  PacketScans(const std::string& path, std::shared_ptr<const MessageContainer> container,
              std::size_t topic);

  std::size_t size() const override { return sweeps_.size(); }
  std::string Name(std::size_t i) const override;
  StampNs Stamp(std::size_t i) const override { return sweeps_.at(i).stamp_ns; }
  Scan Read(std::size_t i) const override;
  PointTimeField PointTimes(std::size_t) const override {
    return {"packets", sensor_->unit_of_times(), false, true};
  }
  RecordingDescription Describe() const override { return described_; }

 private:
  struct Sweep {
    std::size_t begin = 0, end = 0;  // messages, of which some may hold something else
    StampNs stamp_ns = 0;
  };
  std::unique_ptr<OusterSensor> FindSensor(std::size_t topic) const;
  // The packet of a message, or as much of it as was read; empty if it is none of the sensor's.
  std::string_view PacketOf(std::string_view message) const;
  void FindSweeps();
  Scan Decode(std::size_t i, std::string* described) const;

  const std::string path_;
  const std::shared_ptr<const MessageContainer> container_;
  const MessageTopic topic_;
  const std::unique_ptr<OusterSensor> sensor_;
  const std::vector<MessagePlace>& messages_;  // the container's
  std::vector<Sweep> sweeps_;
  std::size_t packets_ = 0;
  RecordingDescription described_;
};

}  // namespace lamina
