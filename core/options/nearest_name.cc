#include "core/options/nearest_name.h"

#include <algorithm>
#include <utility>

namespace lamina {

std::size_t EditDistance(const std::string& a, const std::string& b) {
  // Rows of the table for i - 2, i - 1 and i characters of a.
  std::vector<std::size_t> before, last(b.size() + 1), row;
  for (std::size_t j = 0; j <= b.size(); ++j) last[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    row.assign(b.size() + 1, i);
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t substitute = last[j - 1] + (a[i - 1] == b[j - 1] ? 0 : 1);
      row[j] = std::min({last[j] + 1, row[j - 1] + 1, substitute});
      if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1]) {
        row[j] = std::min(row[j], before[j - 2] + 1);
      }
    }
    before = std::exchange(last, std::move(row));
  }
  return last.back();
}

const std::string& NearestName(const std::string& name, const std::vector<std::string>& names) {
  return *std::min_element(names.begin(), names.end(),
                           [&](const std::string& a, const std::string& b) {
                             return EditDistance(name, a) < EditDistance(name, b);
                           });
}

std::string LikelyName(const std::string& name, const std::vector<std::string>& names) {
  if (name.empty() || names.empty()) return "";
  const auto begins = [](const std::string& text, const std::string& with) {
    return text.compare(0, with.size(), with) == 0;
  };
  const auto extends = std::find_if(names.begin(), names.end(), [&](const std::string& other) {
    return begins(other, name) || begins(name, other);
  });
  if (extends != names.end()) return *extends;
  const std::string& nearest = NearestName(name, names);
  return 2 * EditDistance(name, nearest) <= name.size() ? nearest : "";
}

}  // namespace lamina
