// How fast a sensor moved along one direction while it took several scans: the steady motion under
// which they make the sharpest map.
//
// Two sparse scans hardly share a plane that faces the way: a column of points on a wall is a line,
// two of them are a plane wherever they stand, and what such planes say of the next scan is chance.
// Eight scans together show every wall as what it is, if they are put where they were taken. Under
// a constant acceleration, positions along the unit vector u are, about the middle of the scans,
//
//     x(t) = v t + a t^2 / 2,
//
// and v and a are those that maximise
//
//     L(v, a) = sum_b L_b - v^2 / (2 sv^2) - a^2 / (2 sa^2),
//     L_b = -1/2 a_b mean_i( log(lambda_i + s^2) ),    a_b = n_b / (n_b + n_0),
//
// the mean over the n_b points in the block b of 4 m about the sensor, in which points are of one
// thing, may move together, and so count as one observation; lambda is the smallest eigenvalue of
// the points in the voxel of point i, as in the paper's cost of a voxel (Huang et al., RA-L 2021,
// eq. 7), but of their covariance in the plan: seen along the axis about which the sensor turns.
// The points of one ring in a voxel lie in the sheet that its beams sweep, whatever stands there.
// In space that is as thin as a wall, and thinnest if the sensor has not moved; the plan shows the
// outline of what stands there, which is thin only where it belongs. The ground has no outline:
// what lies lowest in its column of 4 m is judged in space, and so is everything if u is the axis.
// s is the sensor's noise. The logarithm bounds what one voxel can cost, so that corners and
// foliage do not outweigh walls. Voxels of fewer than five points are taken for as thick as 1 m,
// but as 0.12 m where the rays of a scan are those of the next (RaysRepeat). Several shifted grids
// of voxels keep v from being drawn to where the faces of one grid lie. L rises over metres per
// second to its maximum, where the match of a single scan has a minimum every few decimetres.
//
// One motion is refuted by another by so many standard deviations of a sum of independent votes:
//
//     z = sum_b v_b / sqrt(sum_b v_b^2),    v_b = D_b / sqrt(1 + D_b^2),    D_b = L_b - L'_b.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "core/geometry/se3.h"
#include "frontend/start/steady_motion_grid.h"
#include "frontend/start/steady_scan.h"

namespace lamina {

struct SteadyMotionOptions {
  double voxel_size_m = 0.8;
  double noise_m = 0.02;
  double speed_sigma_m_s = 15.0;
  double acceleration_sigma_m_s2 = 4.0;
  // Speed limit of the search.
  double max_speed_m_s = 30.0;
};

struct SteadyMotion {
  double speed_m_s = 0.0, acceleration_m_s2 = 0.0;
};

// Result of a search.
struct FoundMotion {
  SteadyMotion motion;
  std::vector<double> blocks;  // L_b under it
  // Another motion that is not refuted, and L_b under it in the coarse grids.
  struct Rival {
    SteadyMotion motion;
    std::vector<double> blocks;
  };
  std::vector<Rival> rivals;
};

// Runs on several threads, with the same bits at any number.
class SteadyMotionSearch {
 public:
  // At least two scans, by increasing time. `axis`: the sensor's vertical one, a unit vector of the
  // world; the plan is spanned by u and what is across both.
  SteadyMotionSearch(const SteadyMotionOptions& options, const Eigen::Vector3d& u,
                     const Eigen::Vector3d& axis, std::vector<SteadyScan> scans);

  // Whether the rays of a scan are those of the next, as of a sensor whose rings turn.
  bool rays_repeat() const { return few_ == Sparse::kTellNothing; }

  WayAlong WayUnder(const SteadyMotion& motion) const;
  FoundMotion Find() const { return *FindUnless(nullptr); }
  // The same, or nothing, in half the time, if this way refutes all steady motions well apart from
  // it; a motion near it is that way itself.
  std::optional<FoundMotion> FindUnlessRefutedBy(const WayAlong& way) const {
    return FindUnless(&way);
  }
  // Largest difference of speed that another motion, steady or from rest, may have without being
  // refuted by the one that was found. It takes a tenth as long as finding it.
  double OpenSpeed(const FoundMotion& found) const;
  // By how many standard deviations the first one makes the map sharper.
  double Sharper(const WayAlong& one, const WayAlong& other) const;
  double Sharper(const FoundMotion& one, const WayAlong& other) const;
  // The same if `other` is judged in `from`, which has the same scans rotated, or shifted across u,
  // otherwise.
  double Sharper(const WayAlong& one, const SteadyMotionSearch& from, const WayAlong& other) const;

 private:
  using Scratch = SteadyMotionGrid::Scratch;
  using Sparse = SteadyMotionGrid::Sparse;
  using Share = SteadyMotionGrid::Share;
  using Evidence = SteadyMotionGrid::Evidence;
  // Keeps some of the clusters of scans that have very many. Those kept do not depend on poses.
  void ThinOut();
  // Which clusters are judged in 3D: all that may be ground, by the lowest point of each column.
  std::vector<char> ChooseViews(const Eigen::Vector3d& axis) const;
  void MakeGrids(const Eigen::Vector3d& axis);
  // L_b in so many grids.
  std::vector<double> BlocksOf(const WayAlong& way, std::size_t grids, Scratch* scratch) const;
  // The same by the blocks of `places`, which has the same scans.
  std::vector<double> BlocksIn(const SteadyMotionSearch& places, const WayAlong& way,
                               std::size_t grids, Scratch* scratch) const;
  // A candidate motion, and its sums over some of the grids.
  struct Candidate {
    SteadyMotion motion;
    Evidence sums;
  };
  // Adds what a share of the columns of the grids [begin, end) says of each of them.
  void AddGrids(std::size_t begin, std::size_t end, Share share,
                std::vector<Candidate>* candidates) const;
  void AddGrids(const SteadyMotionSearch& places, const WayAlong& way, std::size_t begin,
                std::size_t end, Share share, Scratch* scratch, Evidence* sums) const;
  // L_b from the sums of so many grids.
  std::vector<double> Means(const std::vector<double>& sums, std::size_t grids) const {
    return Means(sums, grids, block_points_);
  }
  // The same of so many points in each block.
  static std::vector<double> Means(const std::vector<double>& sums, std::size_t grids,
                                   const std::vector<double>& points);
  // L from that of its blocks.
  double Total(const SteadyMotion& motion, const std::vector<double>& blocks) const;
  // All motions of the search: of constant speed, and from rest.
  std::vector<Candidate> Candidates() const;
  // Finds the likeliest candidate by its sums over so many grids, with so many points in each
  // block. Removes the others that are impossible or that it refutes; returns its index among those
  // left.
  std::size_t Likeliest(std::size_t grids, const std::vector<double>& points, double refuted_sigmas,
                        std::vector<Candidate>* candidates) const;
  std::optional<FoundMotion> FindUnless(const WayAlong* refuted_by) const;
  // Whether a way refutes a candidate, by the first grid alone.
  bool Refutes(const WayAlong& way, const Candidate& candidate) const;
  // The local maximum of L, by steps from a motion.
  FoundMotion Climb(const SteadyMotion& start) const;
  // Whether the rays of the scans repeat: then far fewer points are in sparse voxels if the sensor
  // is assumed to stand than if it is assumed to move either way.
  bool RaysRepeat() const;

  SteadyMotionOptions options_;
  Eigen::Vector3d u_;
  std::vector<SteadyScan> scans_;
  std::vector<std::int32_t> block_of_;  // of each cluster of each scan
  std::vector<double> block_points_;
  std::vector<SteadyMotionGrid> grids_;
  std::vector<std::vector<std::int32_t>> blocks_;  // of each grid: block_of_ in its order
  Sparse few_ = Sparse::kBlurred;
  double middle_s_ = 0.0, duration_s_ = 0.0, step_m_s_ = 0.0, max_speed_m_s_ = 0.0;
};

}  // namespace lamina
