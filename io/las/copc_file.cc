#include "io/las/copc_file.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>

#include "io/file/byte_numbers.h"

namespace lamina {
namespace {

constexpr char kUser[] = "copc";
constexpr std::uint16_t kInfoRecord = 1, kHierarchyRecord = 1000;

auto OrderOf(const CopcKey& key) { return std::tuple(key.level, key.x, key.y, key.z); }

// The node around it at a level above.
CopcKey Above(const CopcKey& key, int level) {
  const int down = key.level - level;
  return {level, key.x >> down, key.y >> down, key.z >> down};
}

void PutEntry(const CopcKey& key, std::uint64_t place, std::int32_t bytes, std::int32_t points,
              std::string* page) {
  for (const std::int32_t number : {key.level, key.x, key.y, key.z}) AppendNumber(number, page);
  AppendNumber(place, page);
  AppendNumber(bytes, page);
  AppendNumber(points, page);
}

}  // namespace

CopcFile::CopcFile(const std::string& path)
    : points_(path), laz_(LazLayoutOfFormat6(kLazAnyPoints)), writer_(path), spool_(path) {}

void CopcFile::Append(const std::vector<CloudPoint>& points) {
  std::string records;
  points_.Append(points, &records);
  spool_.Append(records);
}

// The edge of the cube is 2^bits units.
int CopcFile::CubeBits() const {
  int bits = CopcNodes::kCellBits;
  for (std::size_t axis = 0; axis < 3 && points_.count() > 0; ++axis) {
    const std::int64_t edge = std::int64_t{points_.most(axis)} - points_.least(axis);
    while (edge >> bits != 0) ++bits;
  }
  return bits;
}

std::string CopcFile::Info() const {
  const double half_m = kLasScaleM * std::ldexp(0.5, CubeBits());
  std::string info;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double least = points_.count() > 0 ? kLasScaleM * points_.least(axis) : 0.0;
    AppendNumber(points_.offset(axis) + least + half_m, &info);
  }
  AppendNumber(half_m, &info);
  AppendNumber(2.0 * half_m / (1 << CopcNodes::kCellBits), &info);
  AppendNumber(root_page_at_, &info);
  AppendNumber(root_page_bytes_, &info);
  AppendNumber(points_.first_s(), &info);
  AppendNumber(points_.last_s(), &info);
  info.append(11 * 8, '\0');
  return info;
}

// All that stands before the chunks; always of the same length.
std::string CopcFile::Head() const {
  const std::string records = LasVariableRecord(kUser, kInfoRecord, "COPC info", Info()) +
                              LasCoordinateSystem() +
                              LasVariableRecord(kLazUser, kLazRecord, "by Lamina", LazRecord(laz_));
  LasLayout layout;
  layout.packed = true;
  layout.variable_records = 3;
  layout.points_at = kLasHeaderBytes + records.size();
  layout.extended_at = extended_at_;
  layout.extended_records = extended_at_ > 0 ? 1 : 0;
  return LasHeader(points_, layout) + records;
}

void CopcFile::Write(std::string_view bytes) {
  writer_.Write(bytes);
  written_ += bytes.size();
}

void CopcFile::WriteNode(const CopcKey& key, std::string_view records) {
  Entry entry;
  entry.key = key;
  if (!records.empty()) {
    const std::string chunk = PackLazChunk(laz_, records);
    entry.place = written_;
    entry.bytes = static_cast<std::int32_t>(chunk.size());
    entry.points = static_cast<std::int32_t>(records.size() / kLasPointBytes);
    chunks_.push_back(
        {static_cast<std::uint32_t>(entry.points), static_cast<std::uint32_t>(chunk.size())});
    Write(chunk);
  }
  entries_.push_back(entry);
}

// In pages, so that of a large cloud a reader needs only those of what it shows: one of the upper
// levels, and one for each node where these end.
void CopcFile::WriteHierarchy() {
  constexpr int kUpperLevels = 5;
  if (entries_.empty()) entries_.emplace_back();
  std::sort(entries_.begin(), entries_.end(),
            [](const Entry& a, const Entry& b) { return OrderOf(a.key) < OrderOf(b.key); });
  std::string upper;
  std::map<std::tuple<int, int, int, int>, std::pair<CopcKey, std::string>> lower;
  for (const Entry& entry : entries_) {
    std::string* page = &upper;
    if (entry.key.level >= kUpperLevels) {
      const CopcKey above = Above(entry.key, kUpperLevels);
      auto& [key, text] = lower[OrderOf(above)];
      key = above;
      page = &text;
    }
    PutEntry(entry.key, entry.place, entry.bytes, entry.points, page);
  }
  constexpr std::size_t kEntryBytes = 32, kRecordHeadBytes = 60;
  root_page_at_ = extended_at_ + kRecordHeadBytes;
  root_page_bytes_ = upper.size() + kEntryBytes * lower.size();
  std::uint64_t place = root_page_at_ + root_page_bytes_;
  std::string pages;
  for (const auto& [order, keyed] : lower) {
    const auto& [key, page] = keyed;
    PutEntry(key, place, static_cast<std::int32_t>(page.size()), -1, &upper);
    place += page.size();
    pages += page;
  }
  Write(LasExtendedRecord(kUser, kHierarchyRecord, "COPC hierarchy", upper + pages));
}

void CopcFile::Commit() {
  Write(Head());
  const std::uint64_t first = written_;
  Write(std::string(kLazTableAtBytes, '\xFF'));
  const std::array<std::int32_t, 3> least = {points_.least(0), points_.least(1), points_.least(2)};
  CopcNodes nodes(
      CubeBits(), kLasPointBytes, least,
      [this](const CopcKey& key, std::string_view records) { WriteNode(key, records); });
  VisitInOctreeOrder(&spool_, kLasPointBytes, least,
                     [&nodes](std::string_view record) { nodes.Add(record); });
  nodes.Finish();
  const std::uint64_t table = written_;
  Write(LazChunkTable(laz_, chunks_));
  extended_at_ = written_;
  WriteHierarchy();
  writer_.Overwrite(first, {reinterpret_cast<const char*>(&table), sizeof(table)});
  writer_.Overwrite(0, Head());
  writer_.Commit();
}

}  // namespace lamina
