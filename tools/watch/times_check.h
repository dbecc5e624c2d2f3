// Whether the times of points mislead, told of the scans of a session: in a wrong unit, say, or of
// clouds that are compensated for motion already.
//
// `run` maps a few scans with and without them before it begins, and leaves them out where they do
// harm. A session must not decide so: what lies in its inbox when it begins is a matter of chance,
// and the same scans shall give the same bytes. So it says what it found, and maps on.
#pragma once

#include <atomic>
#include <cstddef>
#include <optional>
#include <string>

#include "backend/mapping/options.h"
#include "io/inbox/inbox.h"
#include "io/inbox/streamed_scans.h"
#include "tools/watch/files.h"

namespace lamina {

// Looks at stretches of 20 scans, at the beginning of a session and, where the sensor was at rest
// or lost then, farther on: up to three.
class TimesCheck {
 public:
  explicit TimesCheck(const ScanSourceOptions& options) : options_(options) {}

  // Scan i of the session, which is mapped next. Those of a stretch must come one after the other:
  // one in which a session was interrupted is passed over.
  void Add(std::size_t i, const InboxFile& file);
  bool due() const { return scans_ && scans_->size() == kScans; }
  // Maps the scans of the stretch, with their times and without. Why times are not to be used, and
  // what to do; nothing where they are right or nothing tells.
  std::optional<std::string> Look(const WatchFiles& files, const MappingOptions& options,
                                  const std::atomic<bool>& stop);

 private:
  static constexpr std::size_t kScans = 20;
  static constexpr std::size_t kStarts[] = {0, 200, 1000};

  const ScanSourceOptions options_;
  bool settled_ = false;
  std::size_t next_ = 0;                // scan that goes on with the stretch
  std::optional<StreamedScans> scans_;  // of the stretch, numbered from 0
};

}  // namespace lamina
