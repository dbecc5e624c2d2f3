// Keeps a log readable where one thing happens again and again: the first lines of a kind are
// shown, later ones at round counts (20th, 50th, 100th, 200th, ...), with their count.
#pragma once

#include <cstddef>
#include <map>
#include <optional>
#include <string>

namespace lamina {

// Not thread-safe.
class RepeatedLines {
 public:
  // The line as it is to be shown, or nothing. `kind` is what such lines have in common.
  std::optional<std::string> Next(const std::string& kind, const std::string& line);

 private:
  struct Count {
    std::size_t lines = 0, shown_up_to = 0;
  };
  std::map<std::string, Count> counts_;
};

}  // namespace lamina
