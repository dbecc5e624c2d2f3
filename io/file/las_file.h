// Clouds as LAS 1.4 (ASPRS, LAS specification 1.4 R15), for GIS and CAD, and packed as LAZ
// (io/file/laz_points.h).
//
// Point record format 6, or 1 in LAZ, the newest that is packed point by point: coordinates as
// whole numbers of 0.1 mm from an offset near the first point, so that they stay exact at large
// coordinates; intensity in 16 bits; the stamp of each point, in seconds, as GPS time. The
// coordinate system is a local one, in metres. No date of creation: the same points give the same
// bytes.
//
// Private to io/file.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "io/file/file_writer.h"
#include "io/file/map_io.h"

namespace lamina {

// Streams: header and bounds are written again at the end.
class LasFile {
 public:
  // Throws OutputError.
  LasFile(const std::string& path, bool packed);

  // Throws OutputError, also for a point more than 214 km from the first along an axis, or not
  // finite.
  void Append(const std::vector<CloudPoint>& points);
  void Commit();
  std::size_t count() const { return static_cast<std::size_t>(count_); }

 private:
  static constexpr double kScaleM = 1e-4;

  void Begin(const std::vector<CloudPoint>& points);
  void WriteChunk();
  std::int32_t Coordinate(const Eigen::Vector3d& p, int axis) const;
  std::string Header() const;

  std::string path_;
  const bool packed_;
  FileWriter writer_;
  std::string records_;                     // of the chunk that is not packed yet
  std::vector<std::uint32_t> chunk_bytes_;  // of those that are
  std::uint64_t count_ = 0;
  Eigen::Vector3d offset_ = Eigen::Vector3d::Zero();
  float intensity_factor_ = 1.0F;
  std::array<std::int32_t, 3> least_{}, most_{};
};

}  // namespace lamina
