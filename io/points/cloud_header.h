// What the headers of PCD and PLY files have in common.
//
// Private to io/points.
#pragma once

#include <cstddef>
#include <string_view>

#include "io/file/text_input.h"

namespace lamina {

// More than any scan has: a header that says so is wrong.
inline constexpr std::size_t kMostCloudBytes = std::size_t{1} << 31;

// A whole number of at most 32 bits.
std::size_t ParseCount(const LineReader& lines, std::string_view word);

// Goes over the next `rows` lines, each of which must be `columns` numbers.
void CheckNumberRows(std::size_t rows, std::size_t columns, LineReader* lines);

// Without a last line that has no end yet.
inline std::string_view WholeLines(std::string_view text) {
  return text.substr(0, text.rfind('\n') + 1);
}

}  // namespace lamina
