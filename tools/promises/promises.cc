#include "tools/promises/promises.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <sstream>

#include "config/shipped_configs.h"
#include "core/base/error.h"
#include "io/file/text_input.h"

namespace lamina {
namespace {

constexpr std::size_t kColumns = 7;
constexpr const char* kForAll = "(all)";

std::string Trimmed(std::string text) {
  text.erase(std::remove(text.begin(), text.end(), '`'), text.end());
  const auto begin = text.find_first_not_of(" \t\r");
  if (begin == std::string::npos) return "";
  return text.substr(begin, text.find_last_not_of(" \t\r") - begin + 1);
}

// The cells of a line of a table; none for other lines.
std::vector<std::string> Cells(const std::string& line) {
  std::vector<std::string> cells;
  std::istringstream stream(Trimmed(line));
  std::string cell;
  if (!std::getline(stream, cell, '|') || !cell.empty()) return {};
  while (std::getline(stream, cell, '|')) cells.push_back(Trimmed(cell));
  return cells;
}

std::vector<std::string> Words(const std::string& text) {
  std::istringstream stream(text);
  std::vector<std::string> words;
  for (std::string word; stream >> word;) words.push_back(word);
  return words;
}

bool IsConfiguration(const std::string& word) {
  return std::filesystem::path(word).extension() == ".yaml";
}

// Where a row stands, for messages.
struct Row {
  std::string place;
  std::vector<std::string> cells;

  template <typename T>
  T Number(std::size_t column, const char* name) const {
    return Number<T>(cells[column], name);
  }
  template <typename T>
  T Number(const std::string& text, const char* name) const {
    T value = 0;
    const auto [rest, error] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (error != std::errc() || rest != text.data() + text.size() || !(value >= 0)) {
      throw InputError(fmt::format("{}: {} = '{}': must be a number >= 0", place, name, text));
    }
    return value;
  }
  std::optional<int> Most(std::size_t column, const char* name) const {
    if (cells[column] == "any") return std::nullopt;
    return Number<int>(column, name);
  }
};

bool IsHeading(const std::vector<std::string>& cells) {
  return cells[0] == "name" || cells[0].find_first_not_of("-:") == std::string::npos;
}

void ReadBound(const Row& row, Promise* promise) {
  const std::string& text = row.cells[3];
  if (text.empty() || text.back() != '%') {
    promise->within_m = row.Number<double>(text, "within m");
    return;
  }
  promise->within_m = std::numeric_limits<double>::infinity();
  promise->drift_percent = row.Number<double>(Trimmed(text.substr(0, text.size() - 1)), "within m");
}

}  // namespace

std::vector<Promise> ReadPromises(const std::string& path) {
  std::istringstream file(ReadFile(path));
  std::vector<Promise> promises;
  Promise for_all;
  std::string line;
  for (int number = 1; std::getline(file, line); ++number) {
    const Row row{fmt::format("{}:{}", path, number), Cells(line)};
    if (row.cells.empty() || IsHeading(row.cells)) continue;
    if (row.cells.size() != kColumns) {
      throw InputError(
          fmt::format("{}: {} columns; a promise has {}", row.place, row.cells.size(), kColumns));
    }
    Promise promise = for_all;
    promise.name = row.cells[0];
    promise.synth.push_back(row.cells[1]);
    for (const std::string& word : Words(row.cells[2])) {
      if (IsConfiguration(word)) {
        const std::filesystem::path beside = std::filesystem::path(path).parent_path() / word;
        const bool is_shipped =
            !std::filesystem::exists(beside) && FindShippedConfig(word) != nullptr;
        promise.config = is_shipped ? word : beside.string();
      } else {
        promise.set.push_back(word);
      }
    }
    if (promise.name == kForAll) {
      for_all = promise;
      continue;
    }
    ReadBound(row, &promise);
    promise.lost = row.Most(4, "lost");
    promise.degenerate = row.Most(5, "degenerate");
    promise.tried = row.cells[6];
    const auto same = [&](const Promise& p) { return p.name == promise.name; };
    if (std::any_of(promises.begin(), promises.end(), same)) {
      throw InputError(fmt::format("{}: a second promise named {}", row.place, promise.name));
    }
    promises.push_back(promise);
  }
  if (promises.empty()) throw InputError(path + ": no promise in it");
  return promises;
}

std::string FormatPromises(const std::vector<Promise>& promises) {
  const auto code = [](const std::string& text) { return text.empty() ? "" : "`" + text + "`"; };
  const auto most = [](const std::optional<int>& n) { return n ? fmt::format("{}", *n) : "any"; };
  std::string text =
      "| name | lamina synth | lamina run | within m | lost | degenerate | tried |\n"
      "|---|---|---|---|---|---|---|\n";
  for (const Promise& p : promises) {
    std::vector<std::string> run = p.set;
    if (!p.config.empty()) run.insert(run.begin(), p.config);
    const std::string bound = std::isfinite(p.within_m) ? fmt::format("{}", p.within_m)
                                                        : fmt::format("{} %", p.drift_percent);
    text += fmt::format("| {} | {} | {} | {} | {} | {} | {} |\n", p.name,
                        code(fmt::format("{}", fmt::join(p.synth, " "))),
                        code(fmt::format("{}", fmt::join(run, " "))), bound, most(p.lost),
                        most(p.degenerate), p.tried);
  }
  return text;
}

}  // namespace lamina
