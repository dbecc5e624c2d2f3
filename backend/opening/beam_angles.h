// Whether the points of scans lie where the beams of a spinning sensor measured them, or where a
// compensation for the sensor's motion has moved them. Tells where maps do not: at a steady speed
// both make the same map, and where it turns at a start either may lose the way.
//
//     elevation  Each beam turns at one angle, so that a histogram of all points' elevations has as
//                many peaks as there are beams.
//     azimuth    The sensor turns once from one stamp to the next, T, so that azimuth -+ 2 pi t / T
//                of a point at t is the same for all that one beam measures. This alone shows where
//                the sensor turns about the axis of its beams and hardly moves.
//
// Points that were moved by the way since their time have these blurred, and have them sharp again
// once that is taken back.
//
// Private to backend/opening.
#pragma once

#include <cstddef>

#include "core/geometry/scan.h"
#include "core/geometry/scan_source.h"

namespace lamina {

enum class BeamAngles {
  kUnknown,  // no such beams, no motion, or points that are not in the sensor's frame
  kAsMeasured,
  kAsMeasuredAtTheirTimes,  // by azimuths: that the times are right as well
  kCompensated
};

// By some of the scans from `begin` on whose stamps these poses have. They are those that the scans
// as they are tell: of a steady motion, of which only the pose in a sweep is doubtful, not the way.
BeamAngles BeamAnglesOf(const ScanSource& source, std::size_t begin, const Trajectory& poses);

}  // namespace lamina
