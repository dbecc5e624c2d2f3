#include "tools/watch/times_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>

#include "backend/mapping/deskew_choice.h"
#include "tools/run/opening_lines.h"

namespace lamina {
namespace {

// The scans of a stretch, from where their files are by now.
StreamedScans WhereTheyAre(const StreamedScans& scans, const WatchFiles& files,
                           const ScanSourceOptions& options) {
  StreamedScans found(0, options);
  for (std::size_t i = 0; i < scans.size(); ++i) {
    InboxFile file = scans.File(i);
    if (file.recording == nullptr) file.path = files.Find(file.name);
    found.Append(std::move(file));
  }
  return found;
}

}  // namespace

void TimesCheck::Add(std::size_t i, const InboxFile& file) {
  if (settled_) return;
  const bool begins = std::find(std::begin(kStarts), std::end(kStarts), i) != std::end(kStarts);
  if (begins) {
    scans_.emplace(0, options_);
  } else if (i != next_) {
    scans_.reset();
  }
  next_ = i + 1;
  if (scans_) scans_->Append(file);
}

std::optional<std::string> TimesCheck::Look(const WatchFiles& files, const MappingOptions& options,
                                            const std::atomic<bool>& stop) {
  const StreamedScans scans = WhereTheyAre(*scans_, files, options_);
  scans_.reset();
  const DeskewChoice choice = ChooseDeskew(scans, 0, scans.size(), options, &stop);
  settled_ = choice.verdict != DeskewChoice::Verdict::kDeskew || choice.deskewed_m > 0.0;
  if (choice.verdict == DeskewChoice::Verdict::kDeskew) return std::nullopt;
  return fmt::format(
      "{}. This session deskews by them all the same: begin another one with --set "
      "preparation.deskew=off{}",
      DescribeAgainstDeskewing(choice),
      choice.verdict == DeskewChoice::Verdict::kCompensated
          ? ""
          : ", or tell the unit of the times by scans.point_time_unit");
}

}  // namespace lamina
