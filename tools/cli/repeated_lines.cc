#include "tools/cli/repeated_lines.h"

#include <fmt/format.h>

namespace lamina {
namespace {

constexpr std::size_t kShown = 10;

// 1, 2 or 5 times a power of ten.
bool IsRound(std::size_t n) {
  while (n % 10 == 0) n /= 10;
  return n == 1 || n == 2 || n == 5;
}

}  // namespace

std::optional<std::string> RepeatedLines::Next(const std::string& kind, const std::string& line) {
  Count& count = counts_[kind];
  const std::size_t n = ++count.lines;
  if (n > kShown && !IsRound(n)) return std::nullopt;
  const std::size_t hidden = n - count.shown_up_to - 1;
  count.shown_up_to = n;
  if (n == kShown) return line + " (the 10th of its kind; of further ones only some are shown)";
  if (hidden == 0) return line;
  return fmt::format("{} (the {}th of its kind; the {} before it are not shown)", line, n, hidden);
}

}  // namespace lamina
