// Models of LiDAR sensors: where each ray points, when, and how a return is measured.
//
// Rays come in groups that are fired at one instant; a frame takes 0.1 s.
//
//   hdl64   64 beams at +2 .. -24.8 deg (upper 32 every 1/3 deg, lower 32 every 1/2 deg),
//           1900 azimuth steps, 120 m
//   os1     64 beams at +-22.5 deg, 1024 steps, 100 m
//   os1_128 the same with 128 beams
//   vlp16   16 beams at +-15 deg, 1800 steps, 100 m
//   avia    two prisms turn against one another and draw a rosette of 70.4 x 77.2 deg with six
//           beams at once; its phase runs on from scan to scan, so no scan repeats another.
//           24000 rays, 190 m
//   mid360  a mirror turns about the vertical axis 10 times a second while four beams, a degree
//           apart, swing up and down between -7 and 52 deg; its phase runs on as avia's does.
//           20000 rays, 70 m
//   spinning  64 beams, evenly from +15 to -25 deg, 1024 steps, 120 m; where in its first step a
//           scan begins is drawn anew for each
//
//   scattered  as spinning, but each ray points anywhere within its azimuth step and the field of
//           view, drawn anew for each scan: no pattern that goes with the sensor
//
// Each of them can have another number of rays a scan, the last two another number of beams.
//
// The spinning sensors turn clockwise as seen from above and are cut at the rear. With f the
// fraction of the sweep, azimuth = pi (1 - 2 f); the stamp is the instant when they face forward,
// f = 0.5: the convention of KITTI's raw recordings. avia and mid360 are stamped at their first
// ray, f = 0. LiDAR frame: x forward, y left, z up. Immutable: thread-safe.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "tools/synth/engine/primitive.h"

namespace lamina::synth {

// Does a ray that meets a surface come back to the detector? Grazing and far returns fade, and
// glass lets most light through. `cosine` is that of the angle of incidence, `chance` in [0, 1).
bool IsReturned(Material material, double range_m, double cosine, double max_range_m,
                double chance);
// As KITTI has it: in steps of 0.01.
float IntensityOf(Material material, double cosine);

enum class SensorKind { kHdl64, kAvia, kOs1, kVlp16, kSpinning, kScattered, kMid360, kOs1Of128 };
// In the order of SensorKind.
const std::vector<std::string>& SensorNames();

class SensorModel {
 public:
  // `rays` a scan, rounded to whole azimuth steps, and `beams`; 0: those above.
  // Throws OptionError for `beams` of a sensor that has its own.
  explicit SensorModel(SensorKind kind, int rays = 0, int beams = 0);

  std::size_t groups() const { return groups_; }
  std::size_t rays_per_group() const { return rays_per_group_; }
  double min_range_m() const { return min_range_m_; }
  double max_range_m() const { return max_range_m_; }
  double period_s() const { return 0.1; }

  // Seconds from the scan's stamp to the firing of a group.
  double TimeOf(std::int64_t frame, std::size_t group) const;

  // Unit vectors in the LiDAR frame, one for each ray of the group.
  void Directions(std::int64_t frame, std::size_t group,
                  std::vector<Eigen::Vector3d>* directions) const;

 private:
  void SetElevations(std::vector<double> degrees);
  // Share of the sweep that has passed when the group is fired.
  double FractionOf(std::int64_t frame, std::size_t group) const;

  SensorKind kind_;
  std::size_t groups_ = 0, rays_per_group_ = 0;
  double min_range_m_ = 0.0, max_range_m_ = 0.0;
  double stamp_fraction_ = 0.5;
  std::vector<Eigen::Vector2d> beams_;  // cosine and sine of the elevation
};

}  // namespace lamina::synth
