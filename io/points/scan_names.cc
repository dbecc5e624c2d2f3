#include "io/points/scan_names.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <ctime>
#include <limits>

#include "core/base/error.h"
#include "io/file/text_input.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

bool ParseWhole(std::string_view word, std::int64_t* value) {
  const char* const end = word.data() + word.size();
  const auto [ptr, error] = std::from_chars(word.data(), end, *value);
  return !word.empty() && IsDigit(word[0]) && ptr == end && error == std::errc();
}

// How many ns the unit of an epoch stamp of this size has; 0 for a number that is none.
std::int64_t EpochNsPerUnit(std::int64_t value) {
  // From 1e8 to 1e10 seconds: the three ranges do not meet.
  for (const std::int64_t ns_per_unit : {1, 1000, 1000000}) {
    const double seconds = static_cast<double>(value) * static_cast<double>(ns_per_unit) * 1e-9;
    if (seconds >= 1e8 && seconds < 9.2e9) return ns_per_unit;
  }
  return 0;
}

// `2011-09-26 13:02:25.594360375`.
bool ParseDateTime(std::string_view text, StampNs* stamp_ns) {
  constexpr std::string_view kForm = "0000-00-00 00:00:";
  if (text.size() < kForm.size() + 2) return false;
  for (std::size_t i = 0; i < kForm.size(); ++i) {
    const bool separator = text[i] == kForm[i] || (i == 10 && text[i] == 'T');
    if (kForm[i] == '0' ? !IsDigit(text[i]) : !separator) return false;
  }
  const auto number = [&](std::size_t at, std::size_t size) {
    return std::atoi(std::string(text.substr(at, size)).c_str());
  };
  std::tm date = {};
  date.tm_year = number(0, 4) - 1900;
  date.tm_mon = number(5, 2) - 1;
  date.tm_mday = number(8, 2);
  date.tm_hour = number(11, 2);
  date.tm_min = number(14, 2);
  const std::tm as_written = date;
  const std::int64_t minute_s = timegm(&date);
  // timegm makes February 30 a day in March.
  if (date.tm_mon != as_written.tm_mon || date.tm_mday != as_written.tm_mday ||
      date.tm_hour != as_written.tm_hour || date.tm_min != as_written.tm_min) {
    return false;
  }
  const std::string_view seconds = text.substr(kForm.size());
  StampNs ns = 0;
  if (!IsDigit(seconds[0]) || !ParseSecondsNs(seconds, &ns) || ns >= 61'000'000'000) return false;
  // Years whose ns fit 64 bits.
  if (as_written.tm_year < 1700 - 1900 || as_written.tm_year > 2250 - 1900) return false;
  *stamp_ns = minute_s * 1'000'000'000 + ns;
  return true;
}

// A name as the text before its last number, that number and the text behind it.
struct CountedName {
  std::string_view before, number, behind;
};

// The last one of the first `size` characters.
CountedName SplitAtLastNumber(std::string_view name, std::size_t size) {
  std::size_t end = size;
  while (end > 0 && !IsDigit(name[end - 1])) --end;
  std::size_t begin = end;
  while (begin > 0 && IsDigit(name[begin - 1])) --begin;
  return {name.substr(0, begin), name.substr(begin, end - begin), name.substr(end)};
}

// 2024010112 is a day and an hour rather than a second of 2034.
bool IsDateAndHour(std::string_view digits) {
  if (digits.size() != 10 || digits.substr(0, 2) != "20") return false;
  const auto within = [&](std::size_t at, int least, int most) {
    const int value = std::atoi(std::string(digits.substr(at, 2)).c_str());
    return value >= least && value <= most;
  };
  return within(4, 1, 12) && within(6, 1, 31) && within(8, 0, 23);
}

// The stamp at the end of a name that says more: `cloud_1700000000123456789`, and seconds and
// nanoseconds as in `cloud_1700000000_123456789`.
NameStamp StampAtEnd(std::string_view stem) {
  enum Form : std::int64_t { kWhole = 10, kSeconds = -2, kSecondsAndNs = -3 };
  // Counters are none of these seconds, and have fewer digits than nanoseconds.
  const auto of_now = [](double s) { return s > 1e9 && s < 3e9; };
  constexpr std::size_t kNsDigits = 9;
  const CountedName last = SplitAtLastNumber(stem, stem.size());
  std::int64_t number = 0, seconds = 0;
  if (!last.behind.empty() || !ParseWhole(last.number, &number)) return {};
  if (const std::int64_t ns_per_unit = EpochNsPerUnit(number); ns_per_unit != 0) {
    const StampNs stamp_ns = number * ns_per_unit;
    return of_now(SecondsBetween(0, stamp_ns)) ? NameStamp{stamp_ns, kWhole + ns_per_unit}
                                               : NameStamp();
  }
  const char separator = last.before.empty() ? ' ' : last.before.back();
  if (separator != '.' && separator != '_' && separator != '-') return {};
  const CountedName first = SplitAtLastNumber(last.before, last.before.size() - 1);
  if (first.behind.size() != 1 || !ParseWhole(first.number, &seconds)) return {};
  if (!of_now(static_cast<double>(seconds)) || IsDateAndHour(first.number)) return {};
  if (separator != '.') {
    return last.number.size() == kNsDigits
               ? NameStamp{seconds * 1'000'000'000 + number, kSecondsAndNs}
               : NameStamp();
  }
  NameStamp stamp{0, kSeconds};
  const std::string decimal = std::string(first.number) + "." + std::string(last.number);
  return last.number.size() <= kNsDigits && ParseSecondsNs(decimal, &stamp.stamp_ns) ? stamp
                                                                                     : NameStamp();
}

}  // namespace

NameStamp StampFromName(const std::string& name) {
  // Of cloud.pcd.bin.
  constexpr std::string_view kInner = ".pcd";
  const bool inner = name.size() > kInner.size() &&
                     name.compare(name.size() - kInner.size(), kInner.size(), kInner) == 0;
  const std::string stem = inner ? name.substr(0, name.size() - kInner.size()) : name;
  if (const std::optional<std::int64_t> whole = NumberFromName(stem)) {
    const std::int64_t ns_per_unit = EpochNsPerUnit(*whole);
    return {*whole * ns_per_unit, ns_per_unit};
  }
  const bool decimal =
      std::all_of(stem.begin(), stem.end(), [](char c) { return IsDigit(c) || c == '.'; });
  NameStamp stamp;
  if (decimal && ParseSecondsNs(stem, &stamp.stamp_ns)) {
    stamp.form = -1;
    return stamp;
  }
  return StampAtEnd(stem);
}

std::optional<std::int64_t> NumberFromName(const std::string& stem) {
  std::int64_t number = 0;
  return ParseWhole(stem, &number) ? std::optional(number) : std::nullopt;
}

bool IsNextName(std::string_view a, std::string_view b) {
  const auto split = [](std::string_view name) {
    return SplitAtLastNumber(name, std::min(name.rfind('.'), name.size()));
  };
  const CountedName m = split(a), n = split(b);
  std::int64_t from = 0, to = 0;
  return m.before == n.before && m.behind == n.behind && ParseWhole(m.number, &from) &&
         ParseWhole(n.number, &to) && to - 1 == from;
}

std::vector<StampNs> StampsFromNames(const std::vector<fs::path>& files) {
  std::vector<StampNs> stamps;
  std::int64_t form = 0;
  for (const fs::path& file : files) {
    const NameStamp stamp = StampFromName(file.stem().string());
    if (stamps.empty()) form = stamp.form;
    if (stamp.form == 0 || stamp.form != form) return {};
    stamps.push_back(stamp.stamp_ns);
  }
  return stamps;
}

bool ParseStamp(std::string_view line, StampNs* stamp_ns) {
  return ParseDateTime(line, stamp_ns) || ParseSecondsNs(line, stamp_ns);
}

bool NamesAreLineNumbers(const std::vector<fs::path>& files, std::size_t lines) {
  return lines > files.size() && std::all_of(files.begin(), files.end(), [&](const fs::path& file) {
           const std::optional<std::int64_t> number = NumberFromName(file.stem().string());
           return number && static_cast<std::size_t>(*number) < lines;
         });
}

namespace {

std::vector<StampNs> AllStamps(LineReader* lines) {
  std::vector<StampNs> all;
  while (lines->Next()) {
    StampNs* const stamp_ns = &all.emplace_back();
    if (ParseStamp(lines->line(), stamp_ns)) continue;
    lines->Fail("a stamp must be seconds or a date and time like 2011-09-26 13:02:25.594360375");
  }
  return all;
}

}  // namespace

std::size_t CountStamps(const std::string& stamp_file) {
  const std::string text = ReadFile(stamp_file);
  LineReader lines(stamp_file, text);
  return AllStamps(&lines).size();
}

std::vector<StampNs> ReadStamps(const std::string& stamp_file, const std::vector<fs::path>& files) {
  const std::string text = ReadFile(stamp_file);
  LineReader lines(stamp_file, text);
  const std::vector<StampNs> all = AllStamps(&lines);
  if (all.size() < files.size()) {
    lines.Fail(fmt::format("the file ends after {} stamps, but there are {} scans", all.size(),
                           files.size()));
  }
  std::vector<StampNs> stamps;
  const bool by_name = NamesAreLineNumbers(files, all.size());
  for (std::size_t i = 0; i < files.size(); ++i) {
    stamps.push_back(
        all[by_name ? static_cast<std::size_t>(*NumberFromName(files[i].stem().string())) : i]);
  }
  return stamps;
}

}  // namespace lamina
