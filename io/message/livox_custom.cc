// CustomMsg of the Livox drivers: header, timebase (ns), point_num, lidar_id, rsvd[3], then points
// of offset_time (ns from the timebase), x, y, z (float32), reflectivity, tag, line (uint8).
#include <cmath>

#include "core/base/error.h"
#include "io/container/message_container.h"
#include "io/message/lidar_readers.h"

namespace lamina {

Scan ReadLivoxCustom(WireReader* wire, PointTimeUnit, const std::string&, LidarMessageInfo* info) {
  const MessageHeader header = ReadHeader(wire);
  info->stamp_ns = header.stamp_ns;
  info->frame_id = header.frame_id;
  const auto timebase_ns = wire->Number<std::uint64_t>();
  wire->Number<std::uint32_t>();  // the list has its own length
  constexpr std::uint64_t kIdBytes = 4, kPointBytes = 19;
  wire->Bytes(kIdBytes);
  const std::uint32_t count = wire->Count(kPointBytes);
  info->cells = count;
  info->fields = "offset_time (uint32), x y z (float32), reflectivity tag line (uint8)";
  info->times = {"offset_time", "ns", timebase_ns != 0, false};
  Scan scan;
  if (timebase_ns <= static_cast<std::uint64_t>(INT64_MAX / 2)) {
    scan.stamp_ns = static_cast<StampNs>(timebase_ns);
  }
  scan.points.reserve(count);
  scan.time_s.reserve(count);
  for (std::uint32_t i = 0; i < count; ++i) {
    const auto offset_ns = wire->Number<std::uint32_t>();
    ScanPoint p;
    p.x = wire->Number<float>();
    p.y = wire->Number<float>();
    p.z = wire->Number<float>();
    p.intensity = wire->Number<std::uint8_t>();
    wire->Bytes(2);  // tag, line
    if (!std::isfinite(p.x + p.y + p.z) || (p.x == 0.0F && p.y == 0.0F && p.z == 0.0F)) continue;
    info->times.usable = info->times.usable || offset_ns != 0;
    scan.points.push_back(p);
    scan.time_s.push_back(static_cast<float>(1e-9 * static_cast<double>(offset_ns)));
  }
  if (!info->times.usable) scan.time_s.clear();
  return scan;
}

}  // namespace lamina
