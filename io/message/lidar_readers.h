// The readers in the table of lidar_message.cc.
//
// Private to io/message.
#pragma once

#include <string>

#include "core/geometry/scan.h"
#include "io/message/lidar_message.h"
#include "io/message/wire.h"
#include "io/points/point_times.h"

namespace lamina {

// sensor_msgs/PointCloud2.
Scan ReadPointCloud2(WireReader* wire, PointTimeUnit unit, const std::string& name,
                     LidarMessageInfo* info);
// livox_ros_driver/CustomMsg and that of livox_ros_driver2.
Scan ReadLivoxCustom(WireReader* wire, PointTimeUnit unit, const std::string& name,
                     LidarMessageInfo* info);
// velodyne_msgs/VelodyneScan.
Scan ReadVelodyneScan(WireReader* wire, PointTimeUnit unit, const std::string& name,
                      LidarMessageInfo* info);

}  // namespace lamina
