// What the scenes of tools/synth/stations.h are made of, and the way through them. Private to it.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "core/geometry/se3.h"
#include "tools/synth/engine/primitive.h"

namespace lamina::synth {

// Height of the scanner, metres above the floor.
inline constexpr double kTripod = 1.1;

struct StationWorld {
  std::vector<Primitive> fixed;
  std::vector<std::vector<Primitive>> moved;  // of each scan
  std::vector<SE3> T_scene_lidar;
};

// `scans` stations each; within 150 m of the origin.
StationWorld MakeApartment(std::size_t scans, std::int64_t seed);
StationWorld MakeHauptgebaeude(std::size_t scans, std::int64_t seed);
StationWorld MakeStairStations(std::size_t scans, std::int64_t seed);
StationWorld MakePlain(std::size_t scans, std::int64_t seed);
StationWorld MakeGazebo(bool summer, std::size_t scans, std::int64_t seed);
StationWorld MakeWood(bool summer, std::size_t scans, std::int64_t seed);

// Stations `spacing_m` apart along a way through `corners`, which it rounds off; the scanner stands
// `height_m` above the corners' z, looks along the way give or take 15 degrees, and leans by
// up to `lean_rad`.
std::vector<SE3> StationsAlong(const std::vector<Eigen::Vector3d>& corners, std::size_t scans,
                               double spacing_m, double height_m, double lean_rad,
                               std::int64_t seed);

}  // namespace lamina::synth
