#include "tools/campaign/together.h"

#include <fmt/format.h>

#include <stdexcept>

namespace lamina {

void ThrowTogether(const Ranks& ranks, const std::vector<std::string>& failures) {
  std::size_t first = 0;
  while (first + 1 < failures.size() && failures[first].empty()) ++first;
  const char type = failures[first].front();
  std::string message = failures[first].substr(1);
  if (first > 0) message = fmt::format("rank {}: {}", first, message);
  EndedTogether ended;
  if (ranks.rank() > 0) throw ended;
  switch (type) {
    case 'i':
      ended.error = std::make_exception_ptr(InputError(message));
      break;
    case 'o':
      ended.error = std::make_exception_ptr(OptionError(message));
      break;
    case 'w':
      ended.error = std::make_exception_ptr(OutputError(message));
      break;
    case 's':
      ended.error = std::make_exception_ptr(InterruptedError(message));
      break;
    default:
      ended.error = std::make_exception_ptr(std::runtime_error(message));
  }
  throw ended;
}

}  // namespace lamina
