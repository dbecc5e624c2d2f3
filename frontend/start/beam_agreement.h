// Whether the beams of two scans agree, at a relative pose, on how far away things are.
//
// Between the few lines that one scan of a sparse pattern draws on foliage, planes are guesses, and
// most exact on the lines themselves. A pattern that has turned on by a degree from one scan to the
// next is so drawn along: turned back by that degree, the lines of both lie on one another, meet
// the planes where they were made, and fit better than where they belong. Beams say otherwise: two
// that end beside one another have met the same thing, and a right pose has both ends at the same
// distance from the sensor. With p_i the points of one scan brought to the other's frame, and r_j
// the range there of the beam nearest to p_i, over the n points that have one within 8 cm,
//
//     A(T) = sum_i w((|p_i| - r_j) / s) / (n + n_0),    w of core/geometry/robust_kernel.h,
//
// is a share: how many beams come to lie on one another, which is what the pattern decides, does
// not count. In a forest it is 0.4 to 0.6 at the right pose and below 0.2 where lines lie on lines.
// Its maximum is blunt, 0.5 deg and 5 cm wide. n_0 keeps a few from deciding.
//
// Private to frontend/start.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "core/geometry/point_cluster.h"
#include "core/geometry/se3.h"

namespace lamina {

// Of ranges along beams that meet the same thing, in noise of one.
inline constexpr double kRangeSigmas = 3.0;

// Immutable: thread-safe.
class BeamAgreement {
 public:
  // The scan compared with, in its LiDAR frame, deskewed. `range_sigma_m`: s.
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
  // The pose of the largest A that small steps lead to.
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
  // Of the beam nearest to a point; 0 if there is none near.
  double NearestRange(const Eigen::Vector3d& point, double range_m) const;

  double range_sigma_m_;
  std::vector<std::int32_t> cells_;  // the beams of cell c are cells_[c] to cells_[c + 1]
  std::vector<Beam> beams_;          // by cell
};

}  // namespace lamina
