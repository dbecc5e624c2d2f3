#include "tools/benchmark/counters.h"

#include <filesystem>
#include <map>
#include <sstream>
#include <stdexcept>

#include "core/base/error.h"
#include "io/file/text_input.h"
#include "tools/benchmark/child.h"
#include "tools/cli/program_path.h"
#include "tools/results/piece_poses.h"
#include "tools/results/verdict/verdict.h"

namespace lamina {
namespace {

std::string InFolder(const std::string& folder, const char* name) {
  return (std::filesystem::path(folder) / name).string();
}

std::vector<std::string> Under(EventCounter counter, const std::vector<std::string>& argv,
                               const std::string& counts) {
  std::vector<std::string> all;
  if (counter == EventCounter::kPerf) {
    all = {"perf", "stat", "-x", ",", "-e", "instructions:u,cache-misses:u", "-o", counts, "--"};
  } else {
    all = {"valgrind", "--tool=callgrind", "--cache-sim=yes", "--callgrind-out-file=" + counts};
  }
  all.insert(all.end(), argv.begin(), argv.end());
  return all;
}

std::optional<EventCounts> Parse(EventCounter counter, const std::string& text) {
  return counter == EventCounter::kPerf ? ParsePerfStat(text) : ParseCallgrind(text);
}

}  // namespace

const char* NameOf(EventCounter counter) {
  switch (counter) {
    case EventCounter::kPerf:
      return "perf stat";
    case EventCounter::kCallgrind:
      return "callgrind";
    case EventCounter::kNone:
      break;
  }
  return "none";
}

EventCounter FindEventCounter(const std::string& scratch) {
  if (ProgramInPath("perf")) {
    try {
      CountEvents(EventCounter::kPerf, {"true"}, scratch);
      return EventCounter::kPerf;
    } catch (const std::runtime_error&) {
      // Not allowed, or a machine without counters.
    }
  }
  return ProgramInPath("valgrind") ? EventCounter::kCallgrind : EventCounter::kNone;
}

EventCounts CountEvents(EventCounter counter, const std::vector<std::string>& argv,
                        const std::string& scratch) {
  const std::string counts = InFolder(scratch, "counts.txt");
  std::filesystem::remove(counts);
  // The work of a run that is probably wrong is counted nevertheless.
  RunChildWell(Under(counter, argv, counts), InFolder(scratch, "counts_log.txt"), kProbablyWrong);
  const auto found = Parse(counter, ReadFile(counts));
  if (!found) throw InputError(counts + ": has no counts");
  return *found;
}

std::optional<EventCounts> ParsePerfStat(const std::string& text) {
  std::map<std::string, double> counts;
  LineReader lines("perf stat", text);
  while (lines.Next()) {
    const std::vector<std::string_view> cells = SplitAtCommas(lines.line());
    double value = 0.0;
    if (cells.size() < 3 || !ParseNumber(cells[0], &value)) continue;
    counts[std::string(cells[2].substr(0, cells[2].find(':')))] = value;
  }
  if (counts.count("instructions") == 0 || counts.count("cache-misses") == 0) return std::nullopt;
  return EventCounts{counts["instructions"], counts["cache-misses"]};
}

std::optional<EventCounts> ParseCallgrind(const std::string& text) {
  std::vector<std::string> names;
  std::map<std::string, double> counts;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    std::istringstream words(line);
    std::string key, name;
    words >> key;
    if (key == "events:") {
      while (words >> name) names.push_back(name);
    } else if (key == "totals:") {
      double value = 0.0;
      for (const std::string& event : names) {
        if (words >> value) counts[event] = value;
      }
    }
  }
  if (counts.count("Ir") == 0) return std::nullopt;
  // Of the last level: of instructions, of reads, of writes.
  return EventCounts{counts["Ir"], counts["ILmr"] + counts["DLmr"] + counts["DLmw"]};
}

}  // namespace lamina
