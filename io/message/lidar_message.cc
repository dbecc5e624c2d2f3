#include "io/message/lidar_message.h"

#include <fmt/format.h>

#include <algorithm>

#include "core/base/error.h"
#include "io/message/lidar_readers.h"

namespace lamina {
namespace {

struct LidarType {
  const char* name;
  Scan (*read)(WireReader*, PointTimeUnit, const std::string& name, LidarMessageInfo*);
};

constexpr LidarType kLidarTypes[] = {
    {"sensor_msgs/PointCloud2", ReadPointCloud2},
    {"livox_ros_driver/CustomMsg", ReadLivoxCustom},
    {"livox_ros_driver2/CustomMsg", ReadLivoxCustom},
    {"livox_interfaces/CustomMsg", ReadLivoxCustom},
    {"velodyne_msgs/VelodyneScan", ReadVelodyneScan},
};

const LidarType* FindType(const std::string& name) {
  const auto* found = std::find_if(std::begin(kLidarTypes), std::end(kLidarTypes),
                                   [&](const LidarType& type) { return type.name == name; });
  return found == std::end(kLidarTypes) ? nullptr : found;
}

}  // namespace

bool IsLidarTopic(const MessageTopic& topic) {
  return topic.encoding != MessageEncoding::kOther && FindType(topic.type) != nullptr;
}

std::string LidarTypes() {
  std::string names;
  for (const LidarType& type : kLidarTypes) {
    names += fmt::format("{}{}", names.empty() ? "" : ", ", type.name);
  }
  return names;
}

StampNs LidarMessageStamp(const MessageTopic& topic, std::string_view bytes,
                          const std::string& name) {
  WireReader wire(bytes, topic.encoding, name);
  return ReadStamp(&wire);
}

Scan ScanFromMessage(const MessageTopic& topic, std::string_view bytes, PointTimeUnit unit,
                     const std::string& name, LidarMessageInfo* info) {
  const LidarType* type = FindType(topic.type);
  if (type == nullptr) throw InputError(fmt::format("{}: holds no scans: {}", name, topic.type));
  LidarMessageInfo ignored;
  if (info == nullptr) info = &ignored;
  *info = {};
  WireReader wire(bytes, topic.encoding, name);
  return type->read(&wire, unit, name, info);
}

}  // namespace lamina
