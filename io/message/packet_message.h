// Messages that hold one packet of a sensor each: PacketMsg of Ouster's drivers; and the texts in
// which the sensor describes itself beside them.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

#include "io/container/message_container.h"

namespace lamina {

// By its type; such topics hold packets of points or of the IMU.
bool IsPacketTopic(const MessageTopic& topic);
// The types that are read, for people.
std::string PacketTypes();
// A text (std_msgs/String) on a topic called metadata.
bool IsSensorMetadataTopic(const MessageTopic& topic);

struct MessagePacket {
  std::size_t bytes = 0;  // of the whole packet
  std::string_view data;  // as much of it as was given
};
// `bytes` may be only the first ones of the message, kPacketHeadBytes at least. Throws InputError,
// which begins with `name`, as below.
inline constexpr std::size_t kPacketHeadBytes = 72;
MessagePacket PacketInMessage(const MessageTopic& topic, std::string_view bytes,
                              const std::string& name);

std::string TextInMessage(const MessageTopic& topic, std::string_view bytes,
                          const std::string& name);

}  // namespace lamina
