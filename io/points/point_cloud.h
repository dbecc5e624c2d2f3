// Points as clouds of PCL and ROS hold them: any number of fields at any place in each point.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "core/geometry/scan.h"
#include "io/points/point_times.h"

namespace lamina {

struct PointCloudField {
  std::string name;
  std::uint64_t offset = 0;
  // 1 int8, 2 uint8, 3 int16, 4 uint16, 5 int32, 6 uint32, 7 float32, 8 float64; PCL's alone: 9
  // int64, 10 uint64.
  std::uint32_t datatype = 0;
};

struct PointCloudLayout {
  std::vector<PointCloudField> fields;
  std::uint64_t width = 0, height = 0;         // points in a row, rows
  std::uint64_t point_step = 0, row_step = 0;  // bytes from one to the next
  bool big_endian = false;
};

// Which points become points of the scan. Sensors write a point for each pulse: one without a
// return is NaN or, as Ouster's and Livox's, at the origin.
enum class KeptPoints { kAll, kReturns };

// Any set of fields with x, y and z (float32 or float64). Taken up as well, if they are there:
// intensity, reflectivity or i, of any type; and a time of each point under one of the names in
// point_cloud.cc, of any type, see io/points/point_times.h. Upper case and a leading `scalar_`
// (CloudCompare) make no difference. stamp_ns of the scan is 0 unless the times are readings of a
// clock: then it is the earliest of them. Throws InputError, which begins with `name`. `times`, if
// not null, becomes what was understood of the points' times.
Scan ScanFromCloud(const PointCloudLayout& layout, std::string_view data, KeptPoints kept,
                   PointTimeUnit unit, const std::string& name, PointTimeField* times);

}  // namespace lamina
