// What LAS 1.4 files of clouds have in common (ASPRS, LAS specification 1.4 R15): records of point
// format 6, header, and records of variable length.
//
// Coordinates are whole numbers of 0.1 mm from an offset near the first point, so that they stay
// exact at large coordinates; intensity has 16 bits; the stamp of each point, in seconds, is its
// GPS time. The coordinate system is a local one, in metres. No date of creation: the same points
// give the same bytes.
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "io/las/cloud_point.h"

namespace lamina {

inline constexpr std::size_t kLasHeaderBytes = 375, kLasPointBytes = 30;
inline constexpr double kLasScaleM = 1e-4;

// Points become records; what the header says of all of them is kept.
class LasPoints {
 public:
  // Of the file, for errors.
  explicit LasPoints(std::string path) : path_(std::move(path)) {}

  // Appends a record for each. Throws OutputError for a point more than 214 km from the first along
  // an axis, or not finite.
  void Append(const std::vector<CloudPoint>& points, std::string* records);

  std::uint64_t count() const { return count_; }
  // Of an axis; bounds in units, if there is a point.
  double offset(std::size_t axis) const { return offset_(static_cast<Eigen::Index>(axis)); }
  std::int32_t least(std::size_t axis) const { return least_[axis]; }
  std::int32_t most(std::size_t axis) const { return most_[axis]; }
  // Earliest and latest stamp; 0 if there is none.
  double first_s() const { return first_s_; }
  double last_s() const { return last_s_; }

 private:
  void Begin(const std::vector<CloudPoint>& points);
  std::int32_t Coordinate(const Eigen::Vector3d& p, int axis) const;

  const std::string path_;
  std::uint64_t count_ = 0;
  Eigen::Vector3d offset_ = Eigen::Vector3d::Zero();
  float intensity_factor_ = 1.0F;
  std::array<std::int32_t, 3> least_{}, most_{};
  double first_s_ = 0.0, last_s_ = 0.0;
};

struct LasLayout {
  bool packed = false;
  std::uint32_t variable_records = 0;
  std::size_t points_at = 0;
  std::uint64_t extended_at = 0;  // records behind the points
  std::uint32_t extended_records = 0;
};

// Always of the same length.
std::string LasHeader(const LasPoints& points, const LasLayout& layout);

std::string LasVariableRecord(std::string_view user, std::uint16_t number, std::string_view what,
                              std::string_view content);
std::string LasExtendedRecord(std::string_view user, std::uint16_t number, std::string_view what,
                              std::string_view content);
// Of the coordinate system, as well-known text.
std::string LasCoordinateSystem();

}  // namespace lamina
