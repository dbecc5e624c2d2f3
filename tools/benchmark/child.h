// A program run as a child, and what it took.
#pragma once

#include <string>
#include <vector>

namespace lamina {

struct ChildUsage {
  int code = -1;  // exit code; -1: ended by a signal
  double wall_s = 0.0;
  double cpu_s = 0.0;  // user and system, all threads, from start to end of the process
};

// Runs argv[0] (a path, or a name looked for in PATH) to its end; what it prints goes to the file
// `log`. Throws OutputError if it cannot be started.
ChildUsage RunChild(const std::vector<std::string>& argv, const std::string& log);

// The same, for a program that must not fail: throws OutputError with the end of what it printed,
// unless its exit code is 0 or `also_fine`.
ChildUsage RunChildWell(const std::vector<std::string>& argv, const std::string& log,
                        int also_fine = 0);

}  // namespace lamina
