// What the commands that work on a recording share.
#pragma once

#include <tbb/global_control.h>

#include <atomic>
#include <cstddef>
#include <memory>
#include <string>

#include "core/trajectory_metrics.h"
#include "io/file_writer.h"
#include "io/scan_source.h"
#include "tools/run_progress.h"

namespace lamina {

struct FrameRange {
  std::size_t begin = 0, end = 0;
};

// "A:B" is [A, B) of `size` scans, either may be left out; empty text is all. Throws OptionError.
FrameRange ParseFrameRange(const std::string& text, std::size_t size);

// Throws OutputError.
void WriteTextFile(const std::string& path, const std::string& text);

// "auto", "on" or "off".
RunProgress::Mode ProgressMode(const std::string& name);

// Limits TBB to so many threads while it lives; null for 0, no limit. Throws OptionError.
std::unique_ptr<tbb::global_control> LimitThreads(int threads);

// From now on Ctrl-C (and SIGTERM) sets the flag that is returned; a second Ctrl-C ends the program
// at once.
const std::atomic<bool>& StopOnSignals();

// Errors of poses against a true trajectory, which is matched by line number where it has no stamps
// of its own. Throws InputError.
TrajectoryErrors CompareWithTruth(const std::string& path, const ScanSource& source,
                                  const Trajectory& poses);

}  // namespace lamina
