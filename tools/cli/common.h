// What the commands that work on a recording share.
#pragma once

#include <tbb/global_control.h>

#include <atomic>
#include <cstddef>
#include <memory>
#include <stdexcept>
#include <string>

#include "io/file/file_writer.h"
#include "tools/cli/progress.h"

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

// From now on Ctrl-C (and SIGTERM) sets the flag that is returned, and Ctrl-C says on standard
// error that the end is near; a second Ctrl-C ends the program at once.
const std::atomic<bool>& StopOnSignals();

// The signal that has set that flag; 0: none yet.
int StopSignal();

// A command ended before its work was done, because of such a signal, and in good order: the
// message says what is there. The program's exit code is then 128 + the signal's number, as shells
// have it: 130 for Ctrl-C.
struct InterruptedError : std::runtime_error {
  using std::runtime_error::runtime_error;
};

}  // namespace lamina
