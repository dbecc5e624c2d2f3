// velodyne_msgs/VelodyneScan: header, then packets of a stamp and 1206 bytes each: one sweep.
#include <fmt/format.h>

#include "core/base/error.h"
#include "io/message/lidar_readers.h"
#include "io/packet/velodyne_packet.h"

namespace lamina {

Scan ReadVelodyneScan(WireReader* wire, PointTimeUnit, const std::string& name,
                      LidarMessageInfo* info) {
  const MessageHeader header = ReadHeader(wire);
  info->stamp_ns = header.stamp_ns;
  info->frame_id = header.frame_id;
  constexpr std::uint64_t kStampBytes = 8;
  const std::uint32_t count = wire->Count(kStampBytes + kVelodynePacketBytes);
  Scan scan;
  VelodyneDecoder decoder;
  for (std::uint32_t i = 0; i < count; ++i) {
    const auto s = wire->Number<std::uint32_t>(), ns = wire->Number<std::uint32_t>();
    const StampNs stamp_ns = static_cast<StampNs>(s) * 1'000'000'000 + ns;
    if (scan.points.empty() && scan.stamp_ns == 0) scan.stamp_ns = stamp_ns;
    decoder.Add(wire->Bytes(kVelodynePacketBytes), stamp_ns, name, &scan);
  }
  if (scan.points.empty()) throw InputError(fmt::format("{}: holds no returns", name));
  info->cells = scan.points.size();
  info->fields = "packets of " + decoder.Describe();
  info->times = {"packets", "us", scan.stamp_ns != 0, true};
  return scan;
}

}  // namespace lamina
