// Points of LAS formats 0 to 3 as LASzip packs them: chunks of points, each the first one as it is,
// then what the next ones differ by from those before, in the arithmetic coder. Items POINT10,
// GPSTIME11, RGB12 and BYTE of version 2, which is what all programs write for these formats.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace lamina {

// What LASzip puts into a variable length record of its own: user id and record number.
inline constexpr char kLazUser[] = "laszip encoded";
inline constexpr std::uint16_t kLazRecord = 22204;
inline constexpr std::uint32_t kLazChunkPoints = 50000;

struct LazItem {
  std::uint16_t type = 0, bytes = 0, version = 0;
};
struct LazLayout {
  std::uint32_t chunk_points = kLazChunkPoints;
  std::vector<LazItem> items;
  std::size_t record_bytes() const;
};

// The content of that record. Throws InputError, which begins with `name`, for compressors, items
// or versions that are not read: those of formats 6 to 10 among them.
LazLayout ParseLazRecord(std::string_view record, const std::string& name);
// That of point format 1.
LazLayout LazLayoutOfFormat1();
std::string LazRecord(const LazLayout& layout);

// Packs a chunk of whole records.
std::string PackLazChunk(const LazLayout& layout, std::string_view records);
// `points` of them out of a chunk, one after the other. Throws InputError.
void UnpackLazChunk(const LazLayout& layout, std::string_view chunk, std::uint64_t points,
                    const std::string& name, std::string* records);

// The table of the chunks' lengths, which stands behind the last of them.
std::string LazChunkTable(const std::vector<std::uint32_t>& chunk_bytes);
// At most `most` of them. Throws InputError.
std::vector<std::uint32_t> ParseLazChunkTable(std::string_view table, std::size_t most,
                                              const std::string& name);

}  // namespace lamina
