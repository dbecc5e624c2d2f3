#include "io/recording/pcl_scan_reader.h"

#include <fmt/format.h>
#include <pcl/PCLPointCloud2.h>
#include <pcl/console/print.h>
#include <pcl/io/pcd_io.h>
#include <pcl/io/ply_io.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstring>
#include <initializer_list>
#include <sstream>
#include <vector>

#include "core/base/error.h"
#include "io/file/text_input.h"
#include "io/recording/point_file_check.h"
#include "io/recording/point_times.h"

namespace lamina {
namespace {

using pcl::PCLPointCloud2;
using pcl::PCLPointField;

// PCL prints what it meets; here errors are thrown.
void SilencePcl() {
  static const bool done = [] {
    pcl::console::setVerbosityLevel(pcl::console::L_ALWAYS);
    return true;
  }();
  static_cast<void>(done);
}

std::string PlainName(std::string name) {
  std::transform(name.begin(), name.end(), name.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return name.rfind("scalar_", 0) == 0 ? name.substr(7) : name;
}

// The first of `names` that the cloud has; null if it has none.
const PCLPointField* FindField(const PCLPointCloud2& cloud,
                               std::initializer_list<const char*> names) {
  for (const char* name : names) {
    for (const PCLPointField& field : cloud.fields) {
      if (PlainName(field.name) == name) return &field;
    }
  }
  return nullptr;
}

// Calls set(i, value) with the field's value of each point i.
template <typename T, typename Set>
void ForEachValueOf(const PCLPointCloud2& cloud, const PCLPointField& field, const Set& set) {
  const std::size_t points = std::size_t{cloud.width} * cloud.height;
  const std::uint8_t* from = cloud.data.data() + field.offset;
  for (std::size_t i = 0; i < points; ++i, from += cloud.point_step) {
    T value;
    std::memcpy(&value, from, sizeof(T));
    set(i, value);
  }
}

template <typename Set>
void ForEachValue(const PCLPointCloud2& cloud, const PCLPointField& field, const Set& set) {
  switch (field.datatype) {
    case PCLPointField::INT8:
      return ForEachValueOf<std::int8_t>(cloud, field, set);
    case PCLPointField::UINT8:
      return ForEachValueOf<std::uint8_t>(cloud, field, set);
    case PCLPointField::INT16:
      return ForEachValueOf<std::int16_t>(cloud, field, set);
    case PCLPointField::UINT16:
      return ForEachValueOf<std::uint16_t>(cloud, field, set);
    case PCLPointField::INT32:
      return ForEachValueOf<std::int32_t>(cloud, field, set);
    case PCLPointField::UINT32:
      return ForEachValueOf<std::uint32_t>(cloud, field, set);
    case PCLPointField::INT64:
      return ForEachValueOf<std::int64_t>(cloud, field, set);
    case PCLPointField::UINT64:
      return ForEachValueOf<std::uint64_t>(cloud, field, set);
    case PCLPointField::FLOAT32:
      return ForEachValueOf<float>(cloud, field, set);
    case PCLPointField::FLOAT64:
      return ForEachValueOf<double>(cloud, field, set);
    default:
      throw InputError(fmt::format("field '{}' is of unknown type", field.name));
  }
}

void CopyField(const PCLPointCloud2& cloud, const PCLPointField& field, float ScanPoint::*member,
               std::vector<ScanPoint>* points) {
  ForEachValue(cloud, field, [&](std::size_t i, auto value) {
    (*points)[i].*member = static_cast<float>(value);
  });
}

void CopyTimes(const PCLPointCloud2& cloud, const PCLPointField& field, const std::string& path,
               const ScanSourceOptions& options, Scan* scan, PointTimeField* told) {
  std::vector<RawTime> raw(scan->points.size());
  ForEachValue(cloud, field, [&](std::size_t i, auto value) {
    raw[i] = static_cast<RawTime>(value);
    const ScanPoint& p = scan->points[i];
    if (!std::isfinite(raw[i]) && std::isfinite(p.x + p.y + p.z)) {
      throw InputError(
          fmt::format("{}: point {} has a place but no finite '{}'", path, i, field.name));
    }
  });
  const bool is_float32 = field.datatype == PCLPointField::FLOAT32;
  PointTimes times = ConvertPointTimes(raw, is_float32, options.point_time_unit,
                                       fmt::format("{}: field '{}'", path, field.name));
  if (told != nullptr) {
    *told = {field.name, times.unit, times.stamp_ns != 0, !times.time_s.empty()};
  }
  scan->stamp_ns = times.stamp_ns;
  scan->time_s = std::move(times.time_s);
}

Scan ScanFromCloud(const PCLPointCloud2& cloud, const std::string& path,
                   const ScanSourceOptions& options, PointTimeField* times) {
  const std::size_t points = std::size_t{cloud.width} * cloud.height;
  if (cloud.data.size() < points * cloud.point_step) {
    throw InputError(
        fmt::format("{}: is damaged: data for fewer than its {} points", path, points));
  }
  Scan scan;
  scan.points.resize(points);
  const struct {
    const char* name;
    float ScanPoint::*member;
  } axes[] = {{"x", &ScanPoint::x}, {"y", &ScanPoint::y}, {"z", &ScanPoint::z}};
  for (const auto& axis : axes) {
    const PCLPointField* field = FindField(cloud, {axis.name});
    if (field == nullptr) throw InputError(fmt::format("{}: has no field '{}'", path, axis.name));
    if (field->datatype != PCLPointField::FLOAT32 && field->datatype != PCLPointField::FLOAT64) {
      throw InputError(fmt::format("{}: field '{}' must be float or double", path, axis.name));
    }
    CopyField(cloud, *field, axis.member, &scan.points);
  }
  const PCLPointField* intensity = FindField(cloud, {"intensity", "reflectivity", "i"});
  if (intensity != nullptr) CopyField(cloud, *intensity, &ScanPoint::intensity, &scan.points);
  const PCLPointField* time = FindField(
      cloud, {"t", "time", "timestamp", "offset_time", "time_offset", "point_time_offset", "ts"});
  if (time != nullptr) CopyTimes(cloud, *time, path, options, &scan, times);
  return scan;
}

// Runs `read`, which returns negative if it fails, and turns whatever PCL throws into InputError.
template <typename Read>
void WithPcl(const std::string& path, const Read& read) {
  SilencePcl();
  const char* reason = "the data is damaged";
  try {
    if (read() >= 0) return;
  } catch (const std::exception& error) {
    throw InputError(fmt::format("{}: cannot be read: {}", path, error.what()));
  } catch (const char* error) {
    reason = error;
  }
  throw InputError(fmt::format("{}: cannot be read: {}", path, reason));
}

}  // namespace

Scan ReadPcd(const std::string& path, const ScanSourceOptions& options, PointTimeField* times) {
  const std::string bytes = ReadFile(path);
  const PcdLayout layout = CheckPcd(path, bytes);
  if (layout.points == 0) throw InputError(fmt::format("{}: is empty: holds no points", path));
  PCLPointCloud2 cloud;
  WithPcl(path, [&] {
    pcl::PCDReader reader;
    std::istringstream header(bytes.substr(0, layout.data_offset));
    Eigen::Vector4f origin;
    Eigen::Quaternionf orientation;
    int version = 0, kind = 0;
    unsigned int offset = 0;
    int result = reader.readHeader(header, cloud, origin, orientation, version, kind, offset);
    if (result < 0) return result;
    if (layout.data == PcdLayout::Data::kAscii) {
      std::istringstream body(bytes.substr(layout.data_offset));
      return reader.readBodyASCII(body, cloud, version);
    }
    return reader.readBodyBinary(reinterpret_cast<const unsigned char*>(bytes.data()), cloud,
                                 version, layout.data == PcdLayout::Data::kCompressed,
                                 static_cast<unsigned int>(layout.data_offset));
  });
  return ScanFromCloud(cloud, path, options, times);
}

Scan ReadPly(const std::string& path, const ScanSourceOptions& options, PointTimeField* times) {
  CheckPly(path, ReadFile(path));
  PCLPointCloud2 cloud;
  WithPcl(path, [&] { return pcl::PLYReader().read(path, cloud); });
  if (cloud.width == 0 || cloud.height == 0) {
    throw InputError(fmt::format("{}: is empty: holds no points", path));
  }
  return ScanFromCloud(cloud, path, options, times);
}

}  // namespace lamina
