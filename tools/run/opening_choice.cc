#include "tools/run/opening_choice.h"

#include <fmt/format.h>

#include "tools/run/opening_lines.h"

namespace lamina {

OpeningChoice ChooseOpening(const ScanSource& source, const FrameRange& range,
                            const LaminaConfig& config, const ShippedConfig& shipped,
                            const std::atomic<bool>& stop) {
  OpeningChoice choice;
  choice.config = config;
  choice.fit = FindFittingConfig(source, range);
  if (shipped && choice.fit.measured) choice.config = shipped(choice.fit.name);
  ScanPreparationOptions& preparation = choice.config.preparation;
  choice.deskew = ChooseDeskew(source, range.begin, range.end, choice.config.Mapping(), &stop);
  if (choice.deskew.verdict != DeskewChoice::Verdict::kDeskew)
    preparation.deskew = ScanPreparationOptions::Deskew::kOff;
  choice.sweep = ChooseSweep(source, range.begin, range.end, choice.config.Mapping(), &stop);
  preparation = WithSweep(preparation, choice.sweep);
  choice.period = ChooseSweepPeriod(source, range.begin, range.end, choice.config.Mapping(), &stop);
  if (choice.period.period_s > 0.0) preparation.sweep_period_s = choice.period.period_s;
  return choice;
}

std::vector<std::string> OpeningChoice::Warnings() const {
  std::vector<std::string> warnings;
  if (sweep.swept) warnings.push_back(DescribeSweep(sweep));
  if (period.period_s > 0.0) {
    warnings.push_back(fmt::format(
        "a sweep seems to last half as long as the time between two scans: planes are {:.1f} mm "
        "thick with that, {:.1f} mm else. Every second one may be missing "
        "(preparation.sweep_period_s={:.4g})",
        1e3 * period.halved_m, 1e3 * period.by_stamps_m, period.period_s));
  }
  if (deskew.verdict != DeskewChoice::Verdict::kDeskew) {
    warnings.push_back(fmt::format("{}. Not deskewed (preparation.deskew=off{})",
                                   DescribeAgainstDeskewing(deskew),
                                   deskew.verdict == DeskewChoice::Verdict::kCompensated
                                       ? ""
                                       : "; scans.point_time_unit tells their unit"));
  }
  return warnings;
}

}  // namespace lamina
