// Points of LAS files as LASzip packs them: chunks of points, each the first one as it is, then
// what the next ones differ by from those before, in the arithmetic coder.
//
//   formats 0 to 3    point by point: items POINT10, GPSTIME11, RGB12 and BYTE of version 2
//   formats 6 to 10   in layers, one a field: item POINT14 of version 3 or 4. The layers of
//                     colours, waveforms and extra bytes are passed over, and these are zero in
//                     the records
//
// This is what all programs write for these formats.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace lamina {

// What LASzip puts into a variable length record of its own: user id and record number.
inline constexpr char kLazUser[] = "laszip encoded";
inline constexpr std::uint16_t kLazRecord = 22204;
inline constexpr std::uint32_t kLazChunkPoints = 50000;
// Before the first chunk: where the table of the chunks is.
inline constexpr std::size_t kLazTableAtBytes = sizeof(std::int64_t);

// For chunks with as many points as their table says.
inline constexpr std::uint32_t kLazAnyPoints = UINT32_MAX;

enum LazItemType : std::uint16_t {
  kLazByte = 0,
  kLazPoint10 = 6,
  kLazGpsTime11 = 7,
  kLazRgb12 = 8,
  kLazPoint14 = 10,
  kLazRgb14 = 11,
  kLazRgbNir14 = 12,
  kLazWavePacket14 = 13,
  kLazByte14 = 14
};
struct LazItem {
  std::uint16_t type = 0, bytes = 0, version = 0;
};
struct LazLayout {
  bool layered = false;
  std::uint32_t chunk_points = kLazChunkPoints;
  std::vector<LazItem> items;
  std::size_t record_bytes() const;
};

// The content of that record. Throws InputError, which begins with `name`, for compressors, items
// or versions that are not read.
LazLayout ParseLazRecord(std::string_view record, const std::string& name);
// That of point format 6; 1 is what older programs read.
LazLayout LazLayoutOfFormat6(std::uint32_t chunk_points);
LazLayout LazLayoutOfFormat1();
std::string LazRecord(const LazLayout& layout);

// Packs a chunk of whole records, one at least, of point formats 1 or 6.
std::string PackLazChunk(const LazLayout& layout, std::string_view records);
// `points` of them out of a chunk, one after the other. Throws InputError.
using LazVisitor = std::function<void(std::string_view record)>;
void UnpackLazChunk(const LazLayout& layout, std::string_view chunk, std::uint64_t points,
                    const std::string& name, const LazVisitor& visit);

struct LazChunk {
  std::uint32_t points = 0;  // told by the table only if any number is allowed
  std::uint32_t bytes = 0;
};
// The table of the chunks, which stands behind the last of them.
std::string LazChunkTable(const LazLayout& layout, const std::vector<LazChunk>& chunks);
// At most `most` of them. Throws InputError.
std::vector<LazChunk> ParseLazChunkTable(const LazLayout& layout, std::string_view table,
                                         std::size_t most, const std::string& name);

}  // namespace lamina
