// Whether the beams of two scans agree, at a relative pose, on how far away things are.
//
// In foliage a plane fitted to the few lines of one scan of a sparse pattern is arbitrary between
// these lines and most exact on them. If the pattern turns by a degree from one scan to the next,
// matching is biased: turned back by that degree, the lines of both scans coincide, meet the planes
// where they were made, and fit better than at the right pose. Ranges have no such bias: two beams
// that end beside one another have met the same surface, and at the right pose both ends are at the
// same distance from the sensor. With p_i the points of one scan brought to the other's frame, and
// r_j the range there of the beam nearest to p_i, over the n points that have one within 8 cm,
//
//     A(T) = sum_i w((|p_i| - r_j) / s) / (n + n_0),    w of core/geometry/robust_kernel.h,
//
// is a mean over those n, so that the number of beams that come to lie beside one another, which
// depends on the pattern, does not count. In a forest it is 0.4 to 0.6 at the right pose and below
// 0.2 where lines coincide with lines. Its maximum is blunt, 0.5 deg and 5 cm wide. n_0 keeps a few
// beams from deciding.
//
// Private to frontend/start.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "core/geometry/point_cluster.h"
#include "core/geometry/se3.h"

namespace lamina {

// Kernel scale for the difference of two ranges to one surface, in standard deviations of a single
// range.
inline constexpr double kRangeSigmas = 3.0;

// Immutable: thread-safe.
class BeamAgreement {
 public:
  // The first scan, deskewed, in its LiDAR frame. `range_sigma_m`: s.
  BeamAgreement(const std::vector<PointCluster>& clusters, double range_sigma_m);

  struct Shares {
    double beside = 0.0, agree = 0.0;
  };
  // Beside() and Of() in one.
  Shares At(const std::vector<PointCluster>& clusters, const SE3& T_first_other) const;
  // Share of another scan's points that have a beam beside them, at its pose in the frame of the
  // first one. At the identity it says how many rays of one scan the other repeats, as far as means
  // of clusters show it.
  double Beside(const std::vector<PointCluster>& clusters, const SE3& T_first_other) const;
  // A in [0, 1] of another scan, deskewed.
  double Of(const std::vector<PointCluster>& clusters, const SE3& T_first_other) const;
  // |p_i| - r_j, metres, of the points that have a beam beside them.
  std::vector<double> RangesOff(const std::vector<PointCluster>& clusters,
                                const SE3& T_first_other) const;
  // The pose of a local maximum of A, by a coordinate search from the given one.
  SE3 Climb(const std::vector<PointCluster>& clusters, const SE3& T_first_other) const;

 private:
  // Cells of one degree of azimuth and elevation.
  static constexpr int kAzimuths = 360, kElevations = 180;
  struct Beam {
    Eigen::Vector3f direction;
    float range_m = 0.0F;
  };
  struct Sums {
    double asked = 0.0, beside = 0.0, agree = 0.0;
  };
  Sums Ask(const std::vector<PointCluster>& clusters, const SE3& T_first_other) const;
  // Calls visit(range, nearest) for every stride-th point: |p_i|, and r_j or 0 without one.
  template <typename Visit>
  void ForEachRange(const std::vector<PointCluster>& clusters, const SE3& T_first_other,
                    std::size_t stride, const Visit& visit) const;
  // Range, m, of the beam nearest to a point; 0 if none is within 8 cm across the beam, or if the
  // point is nearly above or below the sensor.
  double NearestRange(const Eigen::Vector3d& point, double range_m) const;

  double range_sigma_m_;
  std::vector<std::int32_t> cells_;  // the beams of cell c are cells_[c] to cells_[c + 1]
  std::vector<Beam> beams_;          // by cell
};

}  // namespace lamina
