// Checks of PCD and PLY files before a library reads them. Private to io.
//
// PCL trusts a header: a POINTS beyond the file's size makes it allocate or read without bounds,
// and words in ASCII data that are no numbers become zeros. So the header and, for ASCII, every
// word of the data are held against the file's bytes first. All throw InputError naming file, line
// and rule.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

namespace lamina {

struct PcdLayout {
  enum class Data { kAscii, kBinary, kCompressed };
  Data data = Data::kAscii;
  std::size_t points = 0;
  std::size_t data_offset = 0;  // of the first byte behind the header
};

PcdLayout CheckPcd(const std::string& path, std::string_view bytes);

void CheckPly(const std::string& path, std::string_view bytes);

}  // namespace lamina
