#include "tools/watch/opening_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>

#include "tools/run/fitting_config.h"
#include "tools/run/opening_lines.h"

namespace lamina {
namespace {

// Sizes that were chosen are not doubted.
bool HasDefaultVoxels(const VoxelMapOptions& map) {
  const VoxelMapOptions defaults;
  return map.root_size_m == defaults.root_size_m && map.depth == defaults.depth;
}

}  // namespace

void OpeningCheck::Add(std::size_t i, const InboxFile& file) {
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

StreamedScans OpeningCheck::Stretch(const WatchFiles& files) const {
  StreamedScans found(0, options_);
  for (std::size_t i = 0; scans_ && i < scans_->size(); ++i) {
    InboxFile file = scans_->File(i);
    if (file.recording == nullptr) file.path = files.Find(file.name);
    found.Append(std::move(file));
  }
  return found;
}

void OpeningCheck::Settle(const DeskewChoice& deskew, const SweepChoice& sweep) {
  scans_.reset();
  settled_ = deskew.verdict != DeskewChoice::Verdict::kDeskew || deskew.deskewed_m > 0.0 ||
             sweep.as_they_are_m > 0.0;
}

std::vector<std::string> OpeningCheck::Look(const WatchFiles& files, const MappingOptions& options,
                                            const std::atomic<bool>& stop) {
  const StreamedScans scans = Stretch(files);
  std::vector<std::string> warnings;
  const DeskewChoice choice = ChooseDeskew(scans, 0, scans.size(), options, &stop);
  const SweepChoice sweep = ChooseSweep(scans, 0, scans.size(), options, &stop);
  Settle(choice, sweep);
  if (sweep.swept) {
    warnings.push_back(DescribeSweep(sweep) +
                       ". This session does not deskew them: begin another one with these options");
  }
  if (choice.verdict != DeskewChoice::Verdict::kDeskew) {
    warnings.push_back(
        fmt::format("{}. This session deskews by them all the same: begin another one with --set "
                    "preparation.deskew=off{}",
                    DescribeAgainstDeskewing(choice),
                    choice.verdict == DeskewChoice::Verdict::kCompensated
                        ? ""
                        : ", or tell the unit of the times by scans.point_time_unit"));
  }
  if (fit_told_ || !HasDefaultVoxels(options.mapper.map)) return warnings;
  const FittingConfig fit = FindFittingConfig(scans, {0, scans.size()});
  fit_told_ = fit.measured;
  if (fit.measured) {
    warnings.push_back(
        fmt::format("{}: a session begun with --config {} maps it better", fit.reason, fit.name));
  }
  return warnings;
}

}  // namespace lamina
