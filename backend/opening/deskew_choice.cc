#include "backend/opening/deskew_choice.h"

#include "backend/opening/opening_look.h"

namespace lamina {
namespace {

using Deskew = ScanPreparationOptions::Deskew;

// Whether scans are lost by their times alone. At a start at speed some are lost by right times as
// well, and distorted ones tracked, all bent alike: planes that are as thin by the times speak for
// these.
bool Misled(const OpeningLook& deskewed, const OpeningLook& as_they_are) {
  constexpr double kMostlyLost = 0.5;
  if (deskewed.tracked || !as_they_are.Tells()) return false;
  return deskewed.lost_share > kMostlyLost || !deskewed.HasPlanes() ||
         deskewed.map.median_m > as_they_are.map.median_m;
}

}  // namespace

DeskewChoice ChooseDeskew(const ScanSource& source, std::size_t begin, std::size_t end,
                          const MappingOptions& options, const std::atomic<bool>* stop) {
  // Differences of fewer per cent are within what maps of so few scans vary by.
  constexpr double kClearlyThinner = 0.9;
  DeskewChoice choice;
  if (options.preparation.deskew != Deskew::kAuto) return choice;
  const PointTimes times = PointTimesOf(source, begin, end);
  if (times != PointTimes::kOfTheScan && times != PointTimes::kLonger) return choice;
  ScanPreparationOptions by_times = options.preparation, off = options.preparation;
  by_times.deskew = Deskew::kTime;
  off.deskew = Deskew::kOff;
  const auto looks = LookUnderBoth(
      source, begin, end, options, by_times, off,
      [](const OpeningLook& a, const OpeningLook& b) { return Misled(a, b) || Comparable(a, b); },
      stop);
  if (!looks) return choice;
  const auto& [deskewed, as_they_are] = *looks;
  if (Misled(deskewed, as_they_are)) {
    choice.verdict = DeskewChoice::Verdict::kWrongTimes;
    return choice;
  }
  choice.deskewed_m = deskewed.map.median_m;
  choice.as_they_are_m = as_they_are.map.median_m;
  if (choice.as_they_are_m < kClearlyThinner * choice.deskewed_m) {
    choice.verdict = times == PointTimes::kOfTheScan ? DeskewChoice::Verdict::kCompensated
                                                     : DeskewChoice::Verdict::kWrongTimes;
  }
  return choice;
}

}  // namespace lamina
