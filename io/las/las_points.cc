#include "io/las/las_points.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/base/error.h"
#include "io/file/byte_numbers.h"

namespace lamina {
namespace {

static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "LAS is little-endian");

constexpr std::uint8_t kFormat = 6;

// Padded with zeros to `length`, the last of which stays.
void PutText(std::string_view text, std::size_t length, std::string* bytes) {
  std::string field(text.substr(0, length - 1));
  field.resize(length, '\0');
  *bytes += field;
}

// Both kinds of records differ in the length of their length alone.
template <typename Length>
std::string Record(std::string_view user, std::uint16_t number, std::string_view what,
                   std::string_view content) {
  std::string bytes;
  AppendNumber<std::uint16_t>(0, &bytes);
  PutText(user, 16, &bytes);
  AppendNumber(number, &bytes);
  AppendNumber(static_cast<Length>(content.size()), &bytes);
  PutText(what, 32, &bytes);
  bytes += content;
  return bytes;
}

// Sensors give intensities up to 1, up to 255 or in 16 bits; LAS wants all of the 16.
float IntensityFactor(const std::vector<CloudPoint>& points) {
  float most = 0.0F;
  for (const CloudPoint& p : points) most = std::max(most, p.intensity);
  return most <= 1.0F ? 65535.0F : most <= 255.0F ? 257.0F : 1.0F;
}

std::uint16_t SixteenBits(float value) {
  return static_cast<std::uint16_t>(std::lround(std::clamp(value, 0.0F, 65535.0F)));
}

}  // namespace

void LasPoints::Begin(const std::vector<CloudPoint>& points) {
  if (points.front().p.allFinite()) offset_ = points.front().p.array().round();
  intensity_factor_ = IntensityFactor(points);
  least_.fill(std::numeric_limits<std::int32_t>::max());
  most_.fill(std::numeric_limits<std::int32_t>::min());
  first_s_ = last_s_ = points.front().stamp_s;
}

std::int32_t LasPoints::Coordinate(const Eigen::Vector3d& p, int axis) const {
  const double units = std::round((p(axis) - offset_(axis)) / kLasScaleM);
  if (!(std::abs(units) <= std::numeric_limits<std::int32_t>::max())) {
    throw OutputError(
        fmt::format("{}: a point at {:.3f} m is more than 214 km from the first one, which 32 bits "
                    "of 0.1 mm do not hold",
                    path_, p(axis)));
  }
  return static_cast<std::int32_t>(units);
}

void LasPoints::Append(const std::vector<CloudPoint>& points, std::string* records) {
  if (points.empty()) return;
  if (count_ == 0) Begin(points);
  constexpr std::uint8_t kOnlyReturn = 0x11;  // its number below, number of returns above
  for (const CloudPoint& point : points) {
    for (int axis = 0; axis < 3; ++axis) {
      const auto a = static_cast<std::size_t>(axis);
      const std::int32_t units = Coordinate(point.p, axis);
      least_[a] = std::min(least_[a], units);
      most_[a] = std::max(most_[a], units);
      AppendNumber(units, records);
    }
    const float intensity = std::isfinite(point.intensity) ? point.intensity : 0.0F;
    AppendNumber(SixteenBits(intensity_factor_ * intensity), records);
    AppendNumber(kOnlyReturn, records);
    records->append(7, '\0');  // flags, class, user data, angle, source
    AppendNumber(point.stamp_s, records);
    first_s_ = std::min(first_s_, point.stamp_s);
    last_s_ = std::max(last_s_, point.stamp_s);
  }
  count_ += points.size();
}

std::string LasHeader(const LasPoints& points, const LasLayout& layout) {
  constexpr std::uint16_t kHasWellKnownText = 1 << 4;
  constexpr std::uint8_t kPacked = 0x80;
  std::string h = "LASF";
  AppendNumber<std::uint16_t>(0, &h);
  AppendNumber(kHasWellKnownText, &h);
  h.append(16, '\0');  // project
  h += std::string("\1\4", 2);
  PutText("Lamina", 32, &h);
  PutText("Lamina", 32, &h);
  AppendNumber<std::uint32_t>(0, &h);  // day and year
  AppendNumber(static_cast<std::uint16_t>(kLasHeaderBytes), &h);
  AppendNumber(static_cast<std::uint32_t>(layout.points_at), &h);
  AppendNumber(layout.variable_records, &h);
  AppendNumber(static_cast<std::uint8_t>(layout.packed ? kPacked | kFormat : kFormat), &h);
  AppendNumber(static_cast<std::uint16_t>(kLasPointBytes), &h);
  h.append(24, '\0');  // counts in 32 bits, which are not for this format
  for (int i = 0; i < 3; ++i) AppendNumber(kLasScaleM, &h);
  for (std::size_t i = 0; i < 3; ++i) AppendNumber(points.offset(i), &h);
  for (std::size_t i = 0; i < 3; ++i) {
    const bool any = points.count() > 0;
    AppendNumber(any ? points.offset(i) + kLasScaleM * points.most(i) : 0.0, &h);
    AppendNumber(any ? points.offset(i) + kLasScaleM * points.least(i) : 0.0, &h);
  }
  AppendNumber<std::uint64_t>(0, &h);  // waveforms
  AppendNumber(layout.extended_at, &h);
  AppendNumber(layout.extended_records, &h);
  AppendNumber(points.count(), &h);
  AppendNumber(points.count(), &h);  // of the first return
  h.append(14 * 8, '\0');
  return h;
}

std::string LasVariableRecord(std::string_view user, std::uint16_t number, std::string_view what,
                              std::string_view content) {
  return Record<std::uint16_t>(user, number, what, content);
}

std::string LasExtendedRecord(std::string_view user, std::uint16_t number, std::string_view what,
                              std::string_view content) {
  return Record<std::uint64_t>(user, number, what, content);
}

std::string LasCoordinateSystem() {
  constexpr std::string_view kText =
      "LOCAL_CS[\"Lamina map\",LOCAL_DATUM[\"start of the sensor\",0],UNIT[\"metre\",1],"
      "AXIS[\"X\",EAST],AXIS[\"Y\",NORTH],AXIS[\"Z\",UP]]";
  constexpr std::uint16_t kWellKnownText = 2112;
  std::string content;
  PutText(kText, kText.size() + 1, &content);
  return LasVariableRecord("LASF_Projection", kWellKnownText, "OGC well-known text", content);
}

}  // namespace lamina
