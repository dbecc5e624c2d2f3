// What only some scans of a session can tell of its configuration: whether the times of points
// mislead, in a wrong unit, say, or of clouds that are compensated for motion already; whether
// scans without times are sweeps that are not; and whether the sensor, or a small place, asks for a
// shipped configuration.
//
// `run` looks at a few scans before it begins, and decides. What lies in an inbox when a session
// begins is a matter of chance, and the same scans shall give the same bytes: so the first scans
// decide where no configuration was named (undecided_session.h). Else, and farther on, the session
// says what it found, and maps on.
#pragma once

#include <atomic>
#include <cstddef>
#include <optional>
#include <string>
#include <vector>

#include "backend/mapping/options.h"
#include "backend/opening/deskew_choice.h"
#include "backend/opening/sweep_choice.h"
#include "io/inbox/inbox.h"
#include "io/inbox/streamed_scans.h"
#include "tools/watch/files.h"

namespace lamina {

// Looks at stretches of 20 scans, at the beginning of a session and, where the sensor was at rest
// or lost then, farther on: up to three.
class OpeningCheck {
 public:
  explicit OpeningCheck(const ScanSourceOptions& options) : options_(options) {}

  // Scan i of the session, which is mapped next. Those of a stretch must come one after the other:
  // one in which a session was interrupted is passed over.
  void Add(std::size_t i, const InboxFile& file);
  bool due() const { return scans_ && scans_->size() == kScans; }
  // The scans of the stretch so far, from where their files are by now.
  StreamedScans Stretch(const WatchFiles& files) const;
  // Maps the scans of the stretch, with their times and without. What is not right, and what to do.
  std::vector<std::string> Look(const WatchFiles& files, const MappingOptions& options,
                                const std::atomic<bool>& stop);
  // What the stretch has told, by Look() or elsewhere: it is not looked at again.
  void Settle(const DeskewChoice& deskew, const SweepChoice& sweep);

 private:
  static constexpr std::size_t kScans = 20;
  static constexpr std::size_t kStarts[] = {0, 200, 1000};

  const ScanSourceOptions options_;
  bool settled_ = false;                // of the times
  bool fit_told_ = false;               // that another configuration may fit better
  std::size_t next_ = 0;                // scan that goes on with the stretch
  std::optional<StreamedScans> scans_;  // of the stretch, numbered from 0
};

}  // namespace lamina
