// Whether scans are to be deskewed although their points have times: some recordings were
// compensated for the sensor's motion when they were made, and kept the times; in others the times
// are understood wrongly, in a wrong unit or against stamps that are not theirs.
//
// Of a spinning sensor that moves, the elevation angles of the points tell it: those of its beams
// as they were measured, which a compensation moves (beam_angles.h). Of others a few scans are
// mapped twice, deskewed and as they are. Where the sensor moved, one of both bends what is plane,
// so the right choice gives the thinner map (MeasureThickness), or the only one.
#pragma once

#include <atomic>
#include <cstddef>

#include "backend/mapping/options.h"
#include "core/geometry/scan_source.h"

namespace lamina {

struct DeskewChoice {
  enum class Verdict {
    kDeskew,       // or nothing tells
    kCompensated,  // the scans tell that they are compensated already
    kWrongTimes    // the times mislead: they are not of the scans' own length, or scans are lost by
                   // them that are tracked without
  };
  Verdict verdict = Verdict::kDeskew;
  // Those of the maps that were compared, metres; 0 where nothing was.
  double deskewed_m = 0.0, as_they_are_m = 0.0;
  bool by_beams = false;  // that scans are compensated is told by the beams' elevation angles
};

// For scans [begin, end) of a recording. Looks at the first ones, and where they tell nothing
// (the sensor stood still, or was lost) at some from the middle. Does not look at all unless
// options.preparation.deskew is kAuto and the points have times.
DeskewChoice ChooseDeskew(const ScanSource& source, std::size_t begin, std::size_t end,
                          const MappingOptions& options, const std::atomic<bool>* stop);

}  // namespace lamina
