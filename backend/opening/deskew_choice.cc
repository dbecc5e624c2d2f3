#include "backend/opening/deskew_choice.h"

#include "backend/opening/beam_angles.h"
#include "backend/opening/opening_look.h"

namespace lamina {
namespace {

using Deskew = ScanPreparationOptions::Deskew;
}  // namespace

DeskewChoice ChooseDeskew(const ScanSource& source, std::size_t begin, std::size_t end,
                          const MappingOptions& options, const std::atomic<bool>* stop) {
  DeskewChoice choice;
  if (options.preparation.deskew != Deskew::kAuto) return choice;
  const PointTimes times = PointTimesOf(source, begin, end);
  if (times != PointTimes::kOfTheScan && times != PointTimes::kLonger) return choice;
  ScanPreparationOptions by_times = options.preparation, off = options.preparation;
  by_times.deskew = Deskew::kTime;
  off.deskew = Deskew::kOff;
  BeamAngles angles = BeamAngles::kUnknown;
  const auto looks = LookUnderBoth(
      source, begin, end, options, by_times, off,
      [&](const OpeningLook& deskewed, const OpeningLook& as_they_are) {
        if (times == PointTimes::kOfTheScan && angles == BeamAngles::kUnknown)
          angles = BeamAnglesOf(source, begin, as_they_are.poses);
        return angles == BeamAngles::kCompensated ||
               angles == BeamAngles::kAsMeasuredAtTheirTimes || Misled(deskewed, as_they_are) ||
               Comparable(deskewed, as_they_are);
      },
      stop);
  if (!looks) return choice;
  const auto& [deskewed, as_they_are] = *looks;
  choice.by_beams = angles == BeamAngles::kCompensated;
  if (choice.by_beams) {
    choice.verdict = DeskewChoice::Verdict::kCompensated;
    return choice;
  }
  // Where it turns at a start, scans may be lost by right times, and tracked without.
  if (angles == BeamAngles::kAsMeasuredAtTheirTimes) return choice;
  if (Misled(deskewed, as_they_are)) {
    choice.verdict = DeskewChoice::Verdict::kWrongTimes;
    return choice;
  }
  choice.deskewed_m = deskewed.map.median_m;
  choice.as_they_are_m = as_they_are.map.median_m;
  // At a steady speed the maps are as thin, and noise decides by a few per cent: not against beams.
  if (angles == BeamAngles::kUnknown &&
      choice.as_they_are_m < kClearlyThinner * choice.deskewed_m) {
    choice.verdict = times == PointTimes::kOfTheScan ? DeskewChoice::Verdict::kCompensated
                                                     : DeskewChoice::Verdict::kWrongTimes;
  }
  return choice;
}

}  // namespace lamina
