// Weight of a plane of the map for the beam that meets it.
//
// Points at random depths along the beams of one ring or one stroke of a scan pattern, in foliage
// or smoke or where edges follow one another, lie in the sheet that these beams sweep: a thin
// plane, which contains the lines of sight and moves along with the sensor. A forest under a sensor
// that repeats its pattern is full of such planes, and they fit best if the sensor does not move at
// all.
#pragma once

#include "core/geometry/symmetric3.h"
#include "core/map/surface.h"

namespace lamina {

inline constexpr double kAtSensorM2 = 1e-12;  // m^2: a point without a line of sight counts nothing
inline constexpr double kAlongSine = 0.2;     // sine of the angle below which a plane holds a line
                                              // of sight

// In [0, 1]: near 0 where the line of sight runs within the plane's own slab, whose half-thickness
// over half-breadth is sqrt(flatness), 1 where it crosses it,
//
//     c^2 / (c^2 + flatness),    c = |normal . sight| / |sight|.
//
// `normal` is the plane's and `sight` leads from the sensor to the point, both in one frame.
inline double SightWeight(const Surface& plane, const Eigen::Vector3d& normal,
                          const Eigen::Vector3d& sight) {
  const double along = normal.dot(sight);
  const double along2 = along * along;
  return along2 /
         (along2 + static_cast<double>(plane.flatness) * sight.squaredNorm() + kAtSensorM2);
}

// The arc that one ring of a sweep draws across a corner looks like a plane, too, and moves along
// with the sensor. Such a plane holds the lines of sight to its points.
inline bool AlongSight(const Eigen::Vector3d& normal, const Eigen::Vector3d& sight) {
  const double along = normal.dot(sight);
  return along * along < kAlongSine * kAlongSine * sight.squaredNorm();
}

// Neither age nor points distinguish the sheets of a sensor that stood for long from roads and
// walls that it meets as flatly. Planes met flatter than this do not count for a pose that others
// determine.
inline constexpr double kFlatSine = 0.1;

// The line that one ring draws across a surface is narrow in two directions. The surface faces one
// of them, and the line does not tell which: in the other one it moves along with the sensor, as do
// the circles on the floor. True where points lie within the cone of one ring of a sensor that
// spins about its z axis, with `sight` from there to their mean in the LiDAR frame,
//
//     a' S a / |a|^2 < 0.01 b' S b / |b|^2,    b = z x sight,  a = sight x b.
//
// `scatter` S is any multiple of their covariance, in a frame that R turns the LiDAR's to.
inline bool OnOneRing(const Symmetric3& scatter, const Eigen::Matrix3d& R,
                      const Eigen::Vector3d& sight) {
  constexpr double kNarrow2 = 0.01;
  const Eigen::Vector3d ring(-sight.y(), sight.x(), 0.0);
  const Eigen::Vector3d along = R * ring, across = R * sight.cross(ring);
  return across.dot(scatter * across) * along.squaredNorm() <
         kNarrow2 * along.dot(scatter * along) * across.squaredNorm();
}

// Squared error, rad^2, of a normal of which nothing is known: a row with it is evidence for no
// direction (degeneracy.h), as (x + y)^2 <= 2 (x^2 + y^2).
inline constexpr double kAnyNormal = 2.0;

}  // namespace lamina
