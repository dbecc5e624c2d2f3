#include "io/file/las_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "core/base/error.h"
#include "io/file/laz_points.h"

namespace lamina {
namespace {

static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "LAS is little-endian");

constexpr std::size_t kHeaderBytes = 375;
constexpr std::uint8_t kFormat = 6, kPackedFormat = 1;
constexpr std::size_t kPointBytes = 30, kPackedPointBytes = 28;
constexpr std::string_view kCoordinateSystem =
    "LOCAL_CS[\"Lamina map\",LOCAL_DATUM[\"start of the sensor\",0],UNIT[\"metre\",1],"
    "AXIS[\"X\",EAST],AXIS[\"Y\",NORTH],AXIS[\"Z\",UP]]";

template <typename T>
void Put(T value, std::string* bytes) {
  bytes->append(reinterpret_cast<const char*>(&value), sizeof(T));
}

// Padded with zeros to `length`, the last of which stays.
void PutText(std::string_view text, std::size_t length, std::string* bytes) {
  std::string field(text.substr(0, length - 1));
  field.resize(length, '\0');
  *bytes += field;
}

std::string VariableRecord(std::string_view user, std::uint16_t number, std::string_view what,
                           std::string_view content) {
  std::string bytes;
  Put<std::uint16_t>(0, &bytes);
  PutText(user, 16, &bytes);
  Put(number, &bytes);
  Put(static_cast<std::uint16_t>(content.size()), &bytes);
  PutText(what, 32, &bytes);
  bytes += content;
  return bytes;
}

// The coordinate system as well-known text; and how points are packed, if they are.
std::string VariableRecords(bool packed) {
  constexpr std::uint16_t kWellKnownText = 2112;
  std::string content;
  PutText(kCoordinateSystem, kCoordinateSystem.size() + 1, &content);
  std::string bytes =
      VariableRecord("LASF_Projection", kWellKnownText, "OGC well-known text", content);
  if (packed) {
    bytes += VariableRecord(kLazUser, kLazRecord, "by Lamina", LazRecord(LazLayoutOfFormat1()));
  }
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

LasFile::LasFile(const std::string& path, bool packed)
    : path_(path), packed_(packed), writer_(path) {
  writer_.Write(Header());
  writer_.Write(VariableRecords(packed_));
  // Where the table of the chunks will be.
  if (packed_) writer_.Write(std::string(sizeof(std::int64_t), '\xFF'));
}

void LasFile::WriteChunk() {
  const std::string chunk = PackLazChunk(LazLayoutOfFormat1(), records_);
  writer_.Write(chunk);
  chunk_bytes_.push_back(static_cast<std::uint32_t>(chunk.size()));
  records_.clear();
}

void LasFile::Begin(const std::vector<CloudPoint>& points) {
  if (points.front().p.allFinite()) offset_ = points.front().p.array().round();
  intensity_factor_ = IntensityFactor(points);
  least_.fill(std::numeric_limits<std::int32_t>::max());
  most_.fill(std::numeric_limits<std::int32_t>::min());
}

std::int32_t LasFile::Coordinate(const Eigen::Vector3d& p, int axis) const {
  const double units = std::round((p(axis) - offset_(axis)) / kScaleM);
  if (!(std::abs(units) <= std::numeric_limits<std::int32_t>::max())) {
    throw OutputError(
        fmt::format("{}: a point at {:.3f} m is more than 214 km from the first one, which 32 bits "
                    "of 0.1 mm do not hold",
                    path_, p(axis)));
  }
  return static_cast<std::int32_t>(units);
}

void LasFile::Append(const std::vector<CloudPoint>& points) {
  if (points.empty()) return;
  if (count_ == 0) Begin(points);
  // Number of the return in the lower bits, number of returns above.
  const std::uint8_t only_return = packed_ ? 0x09 : 0x11;
  std::string bytes;
  bytes.reserve(points.size() * kPointBytes);
  for (const CloudPoint& point : points) {
    for (int axis = 0; axis < 3; ++axis) {
      const auto a = static_cast<std::size_t>(axis);
      const std::int32_t units = Coordinate(point.p, axis);
      least_[a] = std::min(least_[a], units);
      most_[a] = std::max(most_[a], units);
      Put(units, &bytes);
    }
    const float intensity = std::isfinite(point.intensity) ? point.intensity : 0.0F;
    Put(SixteenBits(intensity_factor_ * intensity), &bytes);
    Put(only_return, &bytes);
    bytes.append(packed_ ? 5 : 7, '\0');  // flags, class, user data, angle, source
    Put(point.stamp_s, &bytes);
    if (!packed_) continue;
    records_ += bytes;
    bytes.clear();
    if (records_.size() == kLazChunkPoints * kPackedPointBytes) WriteChunk();
  }
  writer_.Write(bytes);
  count_ += points.size();
}

std::string LasFile::Header() const {
  constexpr std::uint16_t kHasWellKnownText = 1 << 4;
  std::string h = "LASF";
  Put<std::uint16_t>(0, &h);
  Put(kHasWellKnownText, &h);
  h.append(16, '\0');  // project
  h += std::string("\1\4", 2);
  PutText("Lamina", 32, &h);
  PutText("Lamina", 32, &h);
  Put<std::uint32_t>(0, &h);  // day and year
  Put(static_cast<std::uint16_t>(kHeaderBytes), &h);
  Put(static_cast<std::uint32_t>(kHeaderBytes + VariableRecords(packed_).size()), &h);
  Put<std::uint32_t>(packed_ ? 2 : 1, &h);
  constexpr unsigned kPacked = 0x80;
  Put(static_cast<std::uint8_t>(packed_ ? kPackedFormat | kPacked : kFormat), &h);
  Put(static_cast<std::uint16_t>(packed_ ? kPackedPointBytes : kPointBytes), &h);
  // Points, and those of the first return, in 32 bits: none with the newer format, or if there are
  // more.
  const bool fits = packed_ && count_ <= std::numeric_limits<std::uint32_t>::max();
  for (int i = 0; i < 2; ++i) Put(fits ? static_cast<std::uint32_t>(count_) : 0U, &h);
  h.append(16, '\0');
  for (int i = 0; i < 3; ++i) Put(kScaleM, &h);
  for (int i = 0; i < 3; ++i) Put(offset_(i), &h);
  for (std::size_t i = 0; i < 3; ++i) {
    const double offset = offset_(static_cast<Eigen::Index>(i));
    Put(count_ > 0 ? offset + kScaleM * most_[i] : 0.0, &h);
    Put(count_ > 0 ? offset + kScaleM * least_[i] : 0.0, &h);
  }
  h.append(20, '\0');  // waveforms, extended records
  Put(count_, &h);
  Put(count_, &h);  // of the first return
  h.append(14 * 8, '\0');
  return h;
}

void LasFile::Commit() {
  if (packed_) {
    if (!records_.empty()) WriteChunk();
    const std::uint64_t first = kHeaderBytes + VariableRecords(packed_).size();
    std::uint64_t end = first + sizeof(std::int64_t);
    for (const std::uint32_t bytes : chunk_bytes_) end += bytes;
    writer_.Write(LazChunkTable(chunk_bytes_));
    std::string place;
    Put(static_cast<std::int64_t>(end), &place);
    writer_.Overwrite(first, place);
  }
  writer_.Overwrite(0, Header());
  writer_.Commit();
}

}  // namespace lamina
