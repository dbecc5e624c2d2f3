// Recordings of a scanner that stands still for each scan: a 2D laser (Hokuyo UTM-30LX) tilted
// through the scene, as in the ETHZ data set (Pomerleau et al., IJRR 2012), with exact poses and
// the exact surfaces.
//
// Sensor: a plane of 1081 rays over 270 degrees, 0.1 to 30 m, tilted from 60 degrees below the
// horizon to 60 above about the axis to the left; `lines` planes a scan. Standard deviation of the
// range: noise_m up to 10 m, twice that beyond (the data sheet's ratio). LiDAR frame: x forward, y
// left, z up.
//
// Scenes, in a scene frame with z up; the world is the LiDAR frame of scan 0:
//
//   apartment       rooms about a corridor, doors open; chairs, tables and door leaves move between
//                   scans
//   hauptgebaeude   a long hall with rows of like pillars, galleries and vaults
//   stairs_ethz     up the flights of a stairwell
//   plain           open rough ground with rocks, nothing upright
//   gazebo_summer, gazebo_winter   pillars and beams on a lawn between walls, overgrown; bare
//   wood_summer, wood_autumn       a path among trees, undergrowth and leaves; trunks and litter
//
// Scan i is a function of the options and i; thread-safe.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "core/geometry/scan.h"
#include "core/options/options.h"
#include "io/recording/scan_source.h"
#include "tools/synth/engine/bvh.h"

namespace lamina {

enum class StationScene {
  kApartment,
  kHauptgebaeude,
  kStairs,
  kPlain,
  kGazeboSummer,
  kGazeboWinter,
  kWoodSummer,
  kWoodAutumn,
};
// In the order of the enumeration.
const std::vector<std::string>& StationSceneNames();

struct StationOptions {
  StationScene scene = StationScene::kApartment;
  // Number of scans; 0: the scene's own, 31 to 45. Fewer end earlier on the same way.
  int scans = 0;
  int seed = 1;
  double noise_m = 0.01;
  // Planes of rays a scan, and every so many rays of a plane.
  int lines = 240;
  int ray_step = 1;

  void Visit(OptionVisitor& v);
};

class StationSequence final : public ScanSource {
 public:
  // Throws OptionError.
  explicit StationSequence(const StationOptions& options);

  std::size_t size() const override { return T_scene_lidar_.size(); }
  std::string Name(std::size_t i) const override;
  StampNs Stamp(std::size_t i) const override;
  Scan Read(std::size_t i) const override { return Generate(i, nullptr); }

  // T_world_lidar of each scan.
  Trajectory Truth() const;
  // Scan i; the places on the surfaces that its rays met, world frame, are appended to `surface`
  // if that is not null.
  Scan Generate(std::size_t i, std::vector<Eigen::Vector3f>* surface) const;
  // Distance of a point of the world to the nearest surface of what does not move.
  double SurfaceDistance(const Eigen::Vector3d& p_world, double bound_m) const;

 private:
  StationOptions options_;
  synth::PrimitiveTree fixed_;
  std::vector<synth::PrimitiveTree> moved_;  // of each scan
  std::vector<SE3> T_scene_lidar_;
};

}  // namespace lamina
