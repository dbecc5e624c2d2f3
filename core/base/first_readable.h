// What a recording shows in the first of its scans or messages that can be read.
#pragma once

#include <algorithm>
#include <cstddef>
#include <optional>

#include "core/base/error.h"

namespace lamina {

// So many are tried: where none of them can be read, the next ones hardly can.
inline constexpr std::size_t kReadTries = 5;

// What read(i) returns for the first i in [begin, end) for which it throws no InputError; nothing
// if it does for the first kReadTries of them.
template <typename Read>
auto FirstReadable(std::size_t begin, std::size_t end, const Read& read)
    -> std::optional<decltype(read(begin))> {
  for (std::size_t i = begin; i < std::min(end, begin + kReadTries); ++i) {
    try {
      return read(i);
    } catch (const InputError&) {
      // The next one may be readable.
    }
  }
  return std::nullopt;
}

}  // namespace lamina
