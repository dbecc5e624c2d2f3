// The sqlite3 files of ROS 2 bags: tables `topics` and `messages`.
//
// Private to io/container.
#pragma once

#include <memory>
#include <string>

#include "io/container/message_container.h"

namespace lamina {

// Messages that were compressed one by one are unpacked. Of a damaged file what can be read is
// there. Throws InputError.
std::unique_ptr<MessageContainer> OpenRosbag2Database(const std::string& path,
                                                      const TopicFilter& wanted);

}  // namespace lamina
