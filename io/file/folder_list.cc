#include "io/file/folder_list.h"

#include <fmt/format.h>

#include <algorithm>

#include "core/base/error.h"
#include "io/file/text_input.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

// Cuts the run of digits that `text` starts with off it; returns it without leading zeros.
std::string_view TakeNumber(std::string_view* text) {
  const auto end = std::find_if_not(text->begin(), text->end(), IsDigit);
  std::string_view number = text->substr(0, static_cast<std::size_t>(end - text->begin()));
  text->remove_prefix(number.size());
  number.remove_prefix(std::min(number.find_first_not_of('0'), number.size()));
  return number;
}

}  // namespace

std::string LowerEnding(std::string_view name) {
  std::string ending = fs::path(name).extension().string();
  for (char& c : ending) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return ending;
}

bool NaturalLess(std::string_view a, std::string_view b) {
  const std::string_view whole_a = a, whole_b = b;
  while (!a.empty() && !b.empty()) {
    if (IsDigit(a[0]) && IsDigit(b[0])) {
      const std::string_view m = TakeNumber(&a), n = TakeNumber(&b);
      if (m != n) return m.size() != n.size() ? m.size() < n.size() : m < n;
    } else if (a[0] != b[0]) {
      return a[0] < b[0];
    } else {
      a.remove_prefix(1);
      b.remove_prefix(1);
    }
  }
  // One may be the other's beginning, or they differ in leading zeros alone.
  if (a.empty() != b.empty()) return a.empty();
  return whole_a < whole_b;
}

std::vector<fs::path> ListFiles(const fs::path& folder, const FileFilter& wanted) {
  std::vector<fs::path> files;
  try {
    for (const fs::directory_entry& entry : fs::directory_iterator(folder)) {
      if (wanted(entry.path().filename().string()) && entry.is_regular_file()) {
        files.push_back(entry.path());
      }
    }
  } catch (const fs::filesystem_error& error) {
    throw InputError(
        fmt::format("{}: cannot be read: {}", folder.string(), error.code().message()));
  }
  std::sort(files.begin(), files.end(), [](const fs::path& a, const fs::path& b) {
    return NaturalLess(a.filename().string(), b.filename().string());
  });
  return files;
}

}  // namespace lamina
