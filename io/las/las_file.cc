#include "io/las/las_file.h"

namespace lamina {
namespace {

std::string VariableRecords(bool packed, const LazLayout& laz) {
  std::string records = LasCoordinateSystem();
  if (packed) records += LasVariableRecord(kLazUser, kLazRecord, "by Lamina", LazRecord(laz));
  return records;
}

}  // namespace

LasFile::LasFile(const std::string& path, bool packed)
    : points_(path),
      packed_(packed),
      laz_(LazLayoutOfFormat6(kLazChunkPoints)),
      variable_records_(VariableRecords(packed, laz_)),
      writer_(path) {
  writer_.Write(Header());
  writer_.Write(variable_records_);
  if (packed_) writer_.Write(std::string(kLazTableAtBytes, '\xFF'));
}

std::string LasFile::Header() const {
  LasLayout layout;
  layout.packed = packed_;
  layout.variable_records = packed_ ? 2 : 1;
  layout.points_at = kLasHeaderBytes + variable_records_.size();
  return LasHeader(points_, layout);
}

void LasFile::WriteChunk(std::string_view records) {
  const std::string chunk = PackLazChunk(laz_, records);
  writer_.Write(chunk);
  LazChunk written;
  written.bytes = static_cast<std::uint32_t>(chunk.size());
  chunks_.push_back(written);
}

void LasFile::Append(const std::vector<CloudPoint>& points) {
  points_.Append(points, &records_);
  if (!packed_) {
    writer_.Write(records_);
    records_.clear();
    return;
  }
  constexpr std::size_t kChunkBytes = kLazChunkPoints * kLasPointBytes;
  std::size_t done = 0;
  for (; records_.size() - done >= kChunkBytes; done += kChunkBytes) {
    WriteChunk(std::string_view(records_).substr(done, kChunkBytes));
  }
  records_.erase(0, done);
}

void LasFile::Commit() {
  if (packed_) {
    if (!records_.empty()) WriteChunk(records_);
    const std::uint64_t first = kLasHeaderBytes + variable_records_.size();
    std::uint64_t table = first + kLazTableAtBytes;
    for (const LazChunk& chunk : chunks_) table += chunk.bytes;
    writer_.Write(LazChunkTable(laz_, chunks_));
    writer_.Overwrite(first, {reinterpret_cast<const char*>(&table), sizeof(table)});
  }
  writer_.Overwrite(0, Header());
  writer_.Commit();
}

}  // namespace lamina
