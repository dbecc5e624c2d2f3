// What a sensor's calibration has wrong of each of its beams, and points corrected by it.
//
// The points of one beam of a spinning sensor lie on a cone: their elevation asin(z / |p|), as the
// driver reports it, is the same in all scans, and tells which beam they are of. A point is
//
//     p -> turned up by elevation_correction about p x z, and moved away by range_correction
//
// (the fields of sensor_intrinsics.h, of a beam in place of all) in the LiDAR frame, z along the
// axis about which the sensor spins.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "core/options/options.h"

namespace lamina {

struct BeamOffset {
  double elevation_deg = 0.0;  // as reported
  double elevation_correction_deg = 0.0;
  double range_correction_m = 0.0;
};

// An option: a list of rows [elevation_deg, elevation_correction_deg, range_correction_m].
void VisitBeams(OptionVisitor& v, const char* name, std::vector<BeamOffset>* beams);

// Immutable: thread-safe.
class BeamTable {
 public:
  static constexpr int kNoBeam = -1;

  // In any order. Without beams all points stay as they are.
  explicit BeamTable(const std::vector<BeamOffset>& beams);

  bool empty() const { return beams_.empty(); }
  std::size_t size() const { return beams_.size(); }
  // The beam of a point, its number in the order of elevations: that which is nearest, if the point
  // is no farther from it than half the way to its neighbour.
  int BeamOf(float x, float y, float z) const;
  void Correct(std::size_t count, float* x, float* y, float* z) const;

 private:
  struct Beam {
    float sine = 0.0F, cosine = 1.0F;  // of the elevation's correction
    float longer_m = 0.0F;
  };
  std::vector<Beam> beams_;
  std::vector<std::int16_t> cells_;  // the beam of each cell of sin(elevation), evenly spaced
};

// The elevations (rad, ascending) at which the beams of a sensor report, from points of some of its
// scans as they stand in the file. Empty if they lie on no cones: the sensor does not spin, its
// beams do not meet in its origin, or the points were moved (deskewed, turned).
std::vector<double> FindBeams(const std::vector<float>& sines_of_elevation);

}  // namespace lamina
