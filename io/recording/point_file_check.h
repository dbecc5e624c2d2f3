// Checks of PCD and PLY files before a library reads them. Private to io.
//
// PCL trusts a header: a POINTS beyond the file's size makes it allocate or read without bounds,
// and words in ASCII data that are no numbers become zeros. So the header and, for ASCII, every
// word of the data are held against the file's bytes first. All throw InputError naming file, line
// and rule.
#pragma once

#include <cstddef>
#include <optional>
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

// How long a file must be, at least, by the header that its first bytes `head` hold: for binary
// data header and points, for ASCII a lower bound. Nothing if the header (or the sizes behind it,
// in compressed data) does not end within `head`. 0 if it breaks a rule: more bytes will not help.
std::optional<std::size_t> DeclaredPcdBytes(std::string_view head);
std::optional<std::size_t> DeclaredPlyBytes(std::string_view head);

}  // namespace lamina
