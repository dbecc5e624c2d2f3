// Instructions and cache misses of a program: by the counters of the processor (perf stat), or,
// where those are not there or not allowed, by running it in a model of one (valgrind's callgrind,
// some fifty times slower, with a last-level cache as large as the machine's).
#pragma once

#include <optional>
#include <string>
#include <vector>

namespace lamina {

struct EventCounts {
  double instructions = 0.0;
  double cache_misses = 0.0;  // of the last level
};

enum class EventCounter { kNone, kPerf, kCallgrind };

// The first of them that works here; `scratch` is a folder for files.
EventCounter FindEventCounter(const std::string& scratch);
const char* NameOf(EventCounter counter);

// Runs the program under the counter. Throws OutputError if it fails, InputError if the counter
// leaves no figures.
EventCounts CountEvents(EventCounter counter, const std::vector<std::string>& argv,
                        const std::string& scratch);

// What `perf stat -x ,` and callgrind leave in their files; nothing if there are no figures.
std::optional<EventCounts> ParsePerfStat(const std::string& text);
std::optional<EventCounts> ParseCallgrind(const std::string& text);

}  // namespace lamina
