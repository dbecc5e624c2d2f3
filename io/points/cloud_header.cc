#include "io/points/cloud_header.h"

#include <fmt/format.h>

#include <charconv>
#include <cstdint>
#include <vector>

namespace lamina {

std::size_t ParseCount(const LineReader& lines, std::string_view word) {
  std::uint32_t count = 0;
  const char* const end = word.data() + word.size();
  const auto [ptr, error] = std::from_chars(word.data(), end, count);
  if (ptr != end || error != std::errc()) {
    lines.Fail("a count must be a whole number of at most 32 bits");
  }
  return count;
}

void CheckNumberRows(std::size_t rows, std::size_t columns, LineReader* lines) {
  std::vector<double> numbers;
  for (std::size_t row = 0; row < rows; ++row) {
    if (!lines->Next()) {
      lines->Fail(fmt::format("the file ends after {} of {} points", row, rows));
    }
    lines->Numbers(&numbers);
    if (numbers.size() != columns) {
      lines->Fail(fmt::format("a point has {} numbers, found {}", columns, numbers.size()));
    }
  }
}

}  // namespace lamina
