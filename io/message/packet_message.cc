// ouster_ros/PacketMsg (ROS 1), ouster_msgs/PacketMsg and ouster_sensor_msgs/PacketMsg (ROS 2): a
// list of bytes, `buf`, and nothing else. std_msgs/String: a text.
#include "io/message/packet_message.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>

#include "io/message/wire.h"

namespace lamina {

namespace {

constexpr const char* kPacketTypes[] = {"ouster_ros/PacketMsg", "ouster_msgs/PacketMsg",
                                        "ouster_sensor_msgs/PacketMsg"};

}  // namespace

bool IsPacketTopic(const MessageTopic& topic) {
  return topic.encoding != MessageEncoding::kOther &&
         std::find(std::begin(kPacketTypes), std::end(kPacketTypes), topic.type) !=
             std::end(kPacketTypes);
}

std::string PacketTypes() {
  return fmt::format("{}", fmt::join(std::begin(kPacketTypes), std::end(kPacketTypes), ", "));
}

bool IsSensorMetadataTopic(const MessageTopic& topic) {
  const std::size_t slash = topic.name.rfind('/');
  return topic.encoding != MessageEncoding::kOther && topic.type == "std_msgs/String" &&
         topic.name.substr(slash == std::string::npos ? 0 : slash + 1) == "metadata";
}

MessagePacket PacketInMessage(const MessageTopic& topic, std::string_view bytes,
                              const std::string& name) {
  WireReader wire(bytes, topic.encoding, name);
  MessagePacket packet;
  packet.bytes = wire.Number<std::uint32_t>();
  packet.data = wire.Bytes(std::min<std::uint64_t>(packet.bytes, wire.left()));
  return packet;
}

std::string TextInMessage(const MessageTopic& topic, std::string_view bytes,
                          const std::string& name) {
  return std::string(WireReader(bytes, topic.encoding, name).Text());
}

}  // namespace lamina
