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
#include "io/recording/sweep_scans.h"

namespace lamina {

// Whether the first messages of a topic hold packets with points, rather than of the IMU.
bool HoldsPointPackets(const MessageContainer& container, std::size_t topic);

// A sweep is stamped when its first packet was recorded. The head of each packet is read once when
// the source is opened. The sensor describes itself in a text on a topic called metadata, that of
// the same name space if there are several, or in a file: see io/packet/sensor_files.h.
class PacketScans final : public SweepScans {
 public:
  // Throws InputError if there are no such packets, or nothing tells how to read them.
  PacketScans(const std::string& path, std::shared_ptr<const MessageContainer> container,
              std::size_t topic);

 private:
  std::unique_ptr<OusterSensor> FindSensor(std::size_t topic) const;
  // The packet of a message, or as much of it as was read; empty if it is none of the sensor's.
  std::string_view PacketOf(std::string_view message) const;
  // How many packets are in them.
  std::uint64_t FindSweeps();
  void ForEachPacket(const Sweep& sweep, const UsePacket& use) const override;
  const PacketSensor& sensor() const override { return *sensor_; }

  const std::shared_ptr<const MessageContainer> container_;
  const MessageTopic topic_;
  const std::unique_ptr<OusterSensor> sensor_;
  const std::vector<MessagePlace>& messages_;  // the container's; a Sweep's place is one of these
};

}  // namespace lamina
