#include "io/recording/pcl_scan_reader.h"

#include <fmt/format.h>
#include <pcl/PCLPointCloud2.h>
#include <pcl/console/print.h>
#include <pcl/io/pcd_io.h>
#include <pcl/io/ply_io.h>

#include <cstdint>
#include <sstream>
#include <string_view>

#include "core/base/error.h"
#include "io/file/text_input.h"
#include "io/message/point_cloud.h"
#include "io/recording/point_file_check.h"

namespace lamina {
namespace {

using pcl::PCLPointCloud2;

// PCL prints what it meets; here errors are thrown.
void SilencePcl() {
  static const bool done = [] {
    pcl::console::setVerbosityLevel(pcl::console::L_ALWAYS);
    return true;
  }();
  static_cast<void>(done);
}

Scan ScanOf(const PCLPointCloud2& cloud, const std::string& path, const ScanSourceOptions& options,
            PointTimeField* times) {
  PointCloudLayout layout;
  layout.width = cloud.width;
  layout.height = cloud.height;
  layout.point_step = cloud.point_step;
  layout.row_step = std::uint64_t{cloud.width} * cloud.point_step;
  for (const pcl::PCLPointField& field : cloud.fields) {
    layout.fields.push_back({field.name, field.offset, field.datatype});
  }
  const std::string_view data(reinterpret_cast<const char*>(cloud.data.data()), cloud.data.size());
  return ScanFromCloud(layout, data, KeptPoints::kAll, options.point_time_unit, path, times);
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
  return ScanOf(cloud, path, options, times);
}

Scan ReadPly(const std::string& path, const ScanSourceOptions& options, PointTimeField* times) {
  CheckPly(path, ReadFile(path));
  PCLPointCloud2 cloud;
  WithPcl(path, [&] { return pcl::PLYReader().read(path, cloud); });
  if (cloud.width == 0 || cloud.height == 0) {
    throw InputError(fmt::format("{}: is empty: holds no points", path));
  }
  return ScanOf(cloud, path, options, times);
}

}  // namespace lamina
