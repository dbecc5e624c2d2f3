// sensor_msgs/PointCloud2: header, height, width, fields (name, offset, datatype, count),
// is_bigendian, point_step, row_step, data, is_dense.
#include <fmt/format.h>

#include <array>

#include "core/base/error.h"
#include "io/message/lidar_readers.h"
#include "io/points/point_cloud.h"

namespace lamina {
namespace {

// "x y z (float32), ring (uint16)".
std::string DescribeFields(const std::vector<PointCloudField>& fields) {
  constexpr std::array<const char*, 9> kTypes = {"?",     "int8",   "uint8",   "int16",  "uint16",
                                                 "int32", "uint32", "float32", "float64"};
  const auto type_of = [&](const PointCloudField& field) {
    return kTypes[field.datatype < kTypes.size() ? field.datatype : 0];
  };
  std::string text;
  for (std::size_t i = 0; i < fields.size(); ++i) {
    text += fields[i].name;
    const bool last_of_type =
        i + 1 == fields.size() || type_of(fields[i]) != type_of(fields[i + 1]);
    if (last_of_type) text += fmt::format(" ({})", type_of(fields[i]));
    if (i + 1 < fields.size()) text += last_of_type ? ", " : " ";
  }
  return text;
}

}  // namespace

Scan ReadPointCloud2(WireReader* wire, PointTimeUnit unit, const std::string& name,
                     LidarMessageInfo* info) {
  const MessageHeader header = ReadHeader(wire);
  info->stamp_ns = header.stamp_ns;
  info->frame_id = header.frame_id;
  PointCloudLayout layout;
  layout.height = wire->Number<std::uint32_t>();
  layout.width = wire->Number<std::uint32_t>();
  constexpr std::uint64_t kLeastFieldBytes = 13;
  constexpr std::uint32_t kMostFields = 1000;
  const std::uint32_t fields = wire->Count(kLeastFieldBytes);
  if (fields > kMostFields) wire->Fail(fmt::format("has {} fields a point", fields));
  for (std::uint32_t i = 0; i < fields; ++i) {
    PointCloudField field;
    field.name = std::string(wire->Text());
    field.offset = wire->Number<std::uint32_t>();
    field.datatype = wire->Number<std::uint8_t>();
    wire->Number<std::uint32_t>();  // count: of several values the first is taken
    layout.fields.push_back(std::move(field));
  }
  layout.big_endian = wire->Number<std::uint8_t>() != 0;
  layout.point_step = wire->Number<std::uint32_t>();
  layout.row_step = wire->Number<std::uint32_t>();
  const std::string_view data = wire->Bytes(wire->Count(1));
  info->cells = layout.width * layout.height;
  info->fields = DescribeFields(layout.fields);
  return ScanFromCloud(layout, data, KeptPoints::kReturns, unit, name, &info->times);
}

}  // namespace lamina
