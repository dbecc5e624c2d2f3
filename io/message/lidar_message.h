// Messages that hold scans: which types there are, and a scan out of each.
//
// To read one more, write a file with a reader as in point_cloud2.cc and give it a line in the
// table of lidar_message.cc.
#pragma once

#include <string>
#include <string_view>

#include "core/geometry/scan.h"
#include "io/container/message_container.h"
#include "io/points/point_times.h"

namespace lamina {

bool IsLidarTopic(const MessageTopic& topic);

// The types that are read, for people.
std::string LidarTypes();

// The stamp in a message's header, out of its first bytes (kHeadBytes are enough). Throws
// InputError, which begins with `name`, as below.
inline constexpr std::size_t kHeadBytes = 16;
StampNs LidarMessageStamp(const MessageTopic& topic, std::string_view bytes,
                          const std::string& name);

// What a message tells beside its points, for people.
struct LidarMessageInfo {
  StampNs stamp_ns = 0;  // of the header
  std::string frame_id;
  std::uint64_t cells = 0;  // points with and without a return
  std::string fields;       // "x y z intensity (float32), ring (uint16), t (uint32)"
  PointTimeField times;
};

// The points with a return, in the order of the message. stamp_ns is 0 unless the points' times are
// readings of a clock; time_s counts from it. `info` may be null.
Scan ScanFromMessage(const MessageTopic& topic, std::string_view bytes, PointTimeUnit unit,
                     const std::string& name, LidarMessageInfo* info);

}  // namespace lamina
