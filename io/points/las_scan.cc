#include "io/points/las_scan.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "core/base/error.h"
#include "io/file/byte_numbers.h"
#include "io/file/text_input.h"
#include "io/las/laz_points.h"
#include "io/points/point_times.h"

namespace lamina {
namespace {

static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "LAS is little-endian");

// By format: the least length of a record, and where its GPS time is (0: it has none).
constexpr std::array<std::size_t, 11> kRecordBytes = {20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67};
constexpr std::array<std::size_t, 11> kTimeAt = {0, 20, 0, 20, 20, 20, 22, 22, 22, 22, 22};
constexpr std::size_t kLeastHeaderBytes = 227, kHeaderBytes14 = 375;
constexpr std::uint8_t kFirstNewFormat = 6;

struct LasHeader {
  std::uint8_t format = 0;
  bool compressed = false;
  std::uint64_t data_at = 0, points = 0;
  std::size_t record_bytes = 0;
  double scale[3] = {}, offset[3] = {};
};

// Throws InputError. `head` has the whole header.
LasHeader ParseHeader(std::string_view head, const std::string& path) {
  const auto fail = [&](const std::string& what) {
    throw InputError(fmt::format("{}: {}", path, what));
  };
  if (head.size() < kLeastHeaderBytes || head.substr(0, 4) != "LASF") fail("is no LAS file");
  const auto major = NumberAt<std::uint8_t>(head, 24), minor = NumberAt<std::uint8_t>(head, 25);
  if (major != 1 || minor > 4) fail(fmt::format("is of LAS version {}.{}", major, minor));
  LasHeader header;
  const std::size_t bytes = NumberAt<std::uint16_t>(head, 94);
  const bool is_14 = minor == 4;
  if (bytes < (is_14 ? kHeaderBytes14 : kLeastHeaderBytes) ||
      (is_14 && head.size() < kHeaderBytes14)) {
    fail(fmt::format("its header has {} bytes", bytes));
  }
  header.data_at = NumberAt<std::uint32_t>(head, 96);
  // Compressors set the highest bits.
  header.compressed = (NumberAt<std::uint8_t>(head, 104) & 0xC0U) != 0;
  header.format = NumberAt<std::uint8_t>(head, 104) & 0x3FU;
  header.record_bytes = NumberAt<std::uint16_t>(head, 105);
  header.points = is_14 ? NumberAt<std::uint64_t>(head, 247) : NumberAt<std::uint32_t>(head, 107);
  if (header.format >= kRecordBytes.size()) {
    fail(fmt::format("its points are of format {}, known are 0 to 10", header.format));
  }
  if (header.record_bytes < kRecordBytes[header.format]) {
    fail(fmt::format("points of format {} have {} bytes, at least {} wanted", header.format,
                     header.record_bytes, kRecordBytes[header.format]));
  }
  if (header.data_at < bytes) fail("its points begin within the header");
  for (std::size_t axis = 0; axis < 3; ++axis) {
    header.scale[axis] = NumberAt<double>(head, 131 + 8 * axis);
    header.offset[axis] = NumberAt<double>(head, 155 + 8 * axis);
    if (!std::isfinite(header.offset[axis]) || !std::isnormal(header.scale[axis])) {
      fail("a scale or an offset is no number");
    }
  }
  return header;
}

bool IsWithheld(std::string_view record, std::uint8_t format) {
  return format < kFirstNewFormat ? (static_cast<unsigned char>(record[15]) & 0x80U) != 0
                                  : (static_cast<unsigned char>(record[15]) & 0x04U) != 0;
}

void CheckFrame(const Scan& scan, const std::string& path) {
  constexpr float kMostM = 10'000.0F;
  for (const ScanPoint& p : scan.points) {
    if (std::abs(p.x) <= kMostM && std::abs(p.y) <= kMostM && std::abs(p.z) <= kMostM) return;
  }
  throw InputError(
      fmt::format("{}: all points are more than 10 km from the origin: a map, and no scan in the "
                  "frame of its sensor",
                  path));
}

}  // namespace

std::optional<std::size_t> DeclaredLasBytes(std::string_view head) {
  if (head.size() < kLeastHeaderBytes) return std::nullopt;
  const bool is_14 = NumberAt<std::uint8_t>(head, 25) == 4;
  if (is_14 && head.size() < kHeaderBytes14) return std::nullopt;
  try {
    const LasHeader header = ParseHeader(head, "");
    constexpr std::uint64_t kMost = std::uint64_t{1} << 40;
    if (!header.compressed) {
      if (header.points > kMost) return 0;
      return static_cast<std::size_t>(header.data_at + header.points * header.record_bytes);
    }
    // The place of the table of chunks: -1 until the last chunk is written.
    if (header.data_at > kMost || head.size() < header.data_at + sizeof(std::uint64_t)) {
      return std::nullopt;
    }
    constexpr std::uint64_t kTableHeadBytes = 8;
    const auto table = NumberAt<std::uint64_t>(head, static_cast<std::size_t>(header.data_at));
    return static_cast<std::size_t>(std::max(table, table + kTableHeadBytes));
  } catch (const InputError&) {
    return 0;
  }
}

namespace {

// The points of a file, one after the other.
class LasRecords {
 public:
  // All must outlive it.
  LasRecords(const LasHeader& header, std::string_view bytes, const std::string& path)
      : header_(header), bytes_(bytes), path_(path) {
    if (header_.compressed) {
      FindChunks();
      return;
    }
    const std::uint64_t room = header_.data_at > bytes_.size()
                                   ? 0
                                   : (bytes_.size() - header_.data_at) / header_.record_bytes;
    if (header_.points > room) {
      throw InputError(fmt::format("{}: is truncated: {} points of {} bytes declared, room for {}",
                                   path_, header_.points, header_.record_bytes, room));
    }
  }

  void ForEach(const LazVisitor& visit) {
    if (!header_.compressed) {
      for (std::uint64_t i = 0; i < header_.points; ++i) {
        visit(bytes_.substr(header_.data_at + i * header_.record_bytes, header_.record_bytes));
      }
      return;
    }
    std::uint64_t left = header_.points;
    for (const LazChunk& chunk : chunks_) {
      const bool told = layout_.chunk_points == kLazAnyPoints;
      const std::uint64_t points =
          told ? chunk.points : std::min<std::uint64_t>(layout_.chunk_points, left);
      if (points > left) Fail("its chunks have more points than the header says");
      if (chunk.bytes > packed_.size()) Fail("its chunks are longer than the file");
      if (points > 0) {
        UnpackLazChunk(layout_, packed_.substr(0, chunk.bytes), points, path_, visit);
      }
      packed_.remove_prefix(chunk.bytes);
      left -= points;
    }
    if (left > 0) Fail("lacks some of its chunks");
  }

 private:
  [[noreturn]] void Fail(const std::string& what) const {
    throw InputError(fmt::format("{}: {}", path_, what));
  }

  void FindChunks() {
    // More than any sensor measures in a sweep: equal points take no bytes to speak of.
    constexpr std::uint64_t kMostPoints = 20'000'000, kMostBytes = std::uint64_t{1} << 30;
    if (header_.points > kMostPoints || header_.points > kMostBytes / header_.record_bytes) {
      Fail(fmt::format("{} compressed points of {} bytes, at most {} and 1 GiB are read as a scan",
                       header_.points, header_.record_bytes, kMostPoints));
    }
    layout_ = ParseLazRecord(FindLazRecord(), path_);
    if (layout_.layered != (header_.format >= kFirstNewFormat)) {
      Fail(fmt::format("points of format {} are not compressed in this way", header_.format));
    }
    if (layout_.record_bytes() != header_.record_bytes) {
      Fail(fmt::format("points of {} bytes, which are {} when unpacked", header_.record_bytes,
                       layout_.record_bytes()));
    }
    constexpr std::size_t kPlaceBytes = sizeof(std::uint64_t);
    if (header_.data_at > bytes_.size() || bytes_.size() - header_.data_at < kPlaceBytes) {
      Fail("is truncated before its points");
    }
    const auto table = NumberAt<std::uint64_t>(bytes_, header_.data_at);
    const std::uint64_t begin = header_.data_at + kPlaceBytes;
    if (table < begin || table > bytes_.size()) Fail("is truncated: has no table of its chunks");
    packed_ = bytes_.substr(begin, table - begin);
    // Sweeps of which half of the points are alike are packed to a fiftieth.
    constexpr std::uint64_t kFewBytes = std::uint64_t{32} << 20, kMostRatio = 1000;
    const std::uint64_t unpacked = header_.points * header_.record_bytes;
    if (unpacked > kFewBytes && unpacked / kMostRatio > packed_.size()) {
      Fail(
          fmt::format("{} compressed bytes cannot have {} points", packed_.size(), header_.points));
    }
    // Each chunk begins with a record as it is.
    const bool any = layout_.chunk_points == kLazAnyPoints;
    const std::uint64_t told =
        any ? header_.points : (header_.points + layout_.chunk_points - 1) / layout_.chunk_points;
    const std::uint64_t most = std::min<std::uint64_t>(told, packed_.size() / header_.record_bytes);
    chunks_ = ParseLazChunkTable(layout_, bytes_.substr(table), most, path_);
  }

  // The content of the variable length record that LASzip makes.
  std::string_view FindLazRecord() const {
    constexpr std::size_t kHeadBytes = 54, kUserBytes = 16;
    const auto count = NumberAt<std::uint32_t>(bytes_, 100);
    std::size_t at = NumberAt<std::uint16_t>(bytes_, 94);
    for (std::uint32_t i = 0; i < count && at + kHeadBytes <= bytes_.size(); ++i) {
      const std::string_view user = bytes_.substr(at + 2, kUserBytes);
      const std::size_t length = NumberAt<std::uint16_t>(bytes_, at + 20);
      if (user.substr(0, user.find('\0')) == kLazUser &&
          NumberAt<std::uint16_t>(bytes_, at + 18) == kLazRecord) {
        return bytes_.substr(at + kHeadBytes, length);
      }
      at += kHeadBytes + length;
    }
    Fail("its points are compressed, and nothing tells how");
  }

  const LasHeader& header_;
  const std::string_view bytes_;
  const std::string& path_;
  LazLayout layout_;
  std::string_view packed_;  // what is not unpacked yet
  std::vector<LazChunk> chunks_;
};

// Adds a point, and its time if its format has one.
void AddRecord(std::string_view record, const LasHeader& header, const std::string& path,
               Scan* scan, std::vector<double>* times) {
  if (IsWithheld(record, header.format)) return;
  float p[3];
  for (std::size_t axis = 0; axis < 3; ++axis) {
    p[axis] = static_cast<float>(header.offset[axis] +
                                 header.scale[axis] * NumberAt<std::int32_t>(record, 4 * axis));
  }
  scan->points.push_back(
      {p[0], p[1], p[2], static_cast<float>(NumberAt<std::uint16_t>(record, 12))});
  const std::size_t time_at = kTimeAt[header.format];
  if (time_at == 0) return;
  times->push_back(NumberAt<double>(record, time_at));
  if (!std::isfinite(times->back())) {
    throw InputError(
        fmt::format("{}: point {} has no finite GPS time", path, scan->points.size() - 1));
  }
}

}  // namespace

Scan ReadLas(const std::string& path, PointTimeUnit /*unit*/, PointTimeField* times) {
  const std::string bytes = ReadFile(path);
  const LasHeader header = ParseHeader(bytes, path);
  LasRecords records(header, bytes, path);
  Scan scan;
  std::vector<double> raw;
  records.ForEach([&](std::string_view record) { AddRecord(record, header, path, &scan, &raw); });
  if (scan.points.empty()) throw InputError(fmt::format("{}: is empty: holds no points", path));
  CheckFrame(scan, path);
  if (raw.empty()) return scan;
  PointTimes read = ConvertPointTimes(raw, PointTimeUnit::kSeconds, path + ": GPS time");
  if (times != nullptr) {
    *times = {"GPS time", read.unit, read.stamp_ns != 0, !read.time_s.empty()};
  }
  scan.stamp_ns = read.stamp_ns;
  scan.time_s = std::move(read.time_s);
  return scan;
}

}  // namespace lamina
