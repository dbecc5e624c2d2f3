// Headers of PCD and PLY files: what they say of the points, held against the file's bytes.
//
// For ASCII every word of the data is looked at as well: none but numbers may stand there. All
// throw InputError naming file, line and rule.
//
// Private to io/points.
#pragma once

#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "io/points/point_cloud.h"

namespace lamina {

struct CloudFileLayout {
  enum class Data { kAscii, kBinary, kCompressed };
  Data data = Data::kAscii;
  PointCloudLayout cloud;  // of the rows; for ASCII, of the rows that they are made to
  // For ASCII: the type of each number of a row.
  std::vector<PointCloudField> columns;
  std::size_t data_offset = 0;    // of the first row, or of the packed bytes
  std::size_t packed_bytes = 0;   // of compressed data
  std::size_t skipped_lines = 0;  // ASCII: of other things than points, from data_offset on
  std::size_t points() const { return static_cast<std::size_t>(cloud.width * cloud.height); }
};

CloudFileLayout CheckPcd(const std::string& path, std::string_view bytes);
CloudFileLayout CheckPly(const std::string& path, std::string_view bytes);

// How long a file must be, at least, by the header that its first bytes `head` hold: for binary
// data header and points, for ASCII a lower bound. Nothing if the header (or the sizes behind it,
// in compressed data) does not end within `head`. 0 if it breaks a rule: more bytes will not help.
std::optional<std::size_t> DeclaredPcdBytes(std::string_view head);
std::optional<std::size_t> DeclaredPlyBytes(std::string_view head);

}  // namespace lamina
