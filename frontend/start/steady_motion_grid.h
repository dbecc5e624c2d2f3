// The voxels of one grid in which steady motions are judged (steady_motion.h).
//
// All that a motion moves, it moves along u. Where a cluster lies across u, and so its column of
// voxels along u, is the same for each motion: clusters are sorted by column once, and a motion is
// judged column by column, with one coordinate to look up, in memory that stays in the cache.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "frontend/start/steady_scan.h"

namespace lamina {

// Orthonormal; along and across span the plan.
struct SteadyMotionAxes {
  Eigen::Vector3d along, across, up;
};

// Constant once it is made: several threads may use one, each with a scratch of its own.
class SteadyMotionGrid {
 public:
  // `is_in_space`, of each cluster of each scan: whether it is judged there, not in the plan. What
  // is has voxels of its own. `shift`: of the grid, in voxels.
  SteadyMotionGrid(double voxel_size_m, double noise_m, const SteadyMotionAxes& axes,
                   const std::vector<SteadyScan>& scans, const std::vector<char>& is_in_space,
                   const Eigen::Vector3d& shift);

  // Sums over the points of a voxel, about its middle, in the plan.
  struct Voxel {
    float n = 0.0F, x = 0.0F, y = 0.0F, xx = 0.0F, xy = 0.0F, yy = 0.0F;
    std::int32_t first_scan = 0;
    std::int32_t others = 0;  // not 0 if further scans see it
  };
  // Those beside them of what is judged in space.
  struct Height {
    float z = 0.0F, xz = 0.0F, yz = 0.0F, zz = 0.0F;
  };
  // Voxels of few points. Blurred: as of 1 m, so that what puts the points of all scans together is
  // sharper. Rays that are the same in each scan meet a wall along u in the same spots if the
  // sensor stands, and in others where it moves, whichever is true: then they tell nothing.
  enum class Sparse { kBlurred, kTellNothing };
  // Memory that one judgement leaves to the next.
  struct Scratch {
    std::vector<float> x_m;           // of each cluster, from the middle of its voxel along u
    std::vector<std::int32_t> along;  // number of that voxel along u, later in `voxels`
    // Of one column: the voxel at each number along u, kNone but while it is summed, and these.
    std::vector<std::int32_t> voxel_at, numbers;
    std::vector<Voxel> voxels;
    std::vector<Height> heights;   // of a column in space alone
    std::vector<float> sharpness;  // of each voxel
  };

  // What several grids say of one way.
  struct Evidence {
    std::vector<double> blocks;  // L_b of each
    double shared = 0.0;         // points in voxels that several scans see
    double sparse = 0.0;         // points in voxels that hold few
  };
  // Adds, under this way, n_i (-1/2 log(lambda_i + s^2)) of each cluster i to the sum of its block.
  void AddSharpness(const WayAlong& way, const std::vector<std::int32_t>& block_of, Sparse few,
                    Scratch* scratch, Evidence* sums) const;

 private:
  static constexpr std::int32_t kNone = -1;

  // Clusters [begin, end) of the sorted ones.
  struct Column {
    std::size_t begin = 0, end = 0;
    bool in_space = false;
  };
  // Sums over the points of a cluster, about where it is along u and the middle of its column.
  struct Member {
    float n, y, xx, xy, yy;
    std::int32_t cluster;  // its number among those of all scans
  };

  void FindAlong(const WayAlong& way, Scratch* scratch) const;
  // Of one column, into scratch->voxels and what is beside them.
  void SumVoxels(const Column& column, Scratch* scratch) const;
  void AddHeights(const Column& column, Scratch* scratch) const;
  float SharpnessOf(const Voxel& voxel, const Height* height) const;

  float voxel_size_m_, inverse_size_;
  double noise2_;
  std::vector<Column> columns_;
  std::vector<Member> members_;
  std::vector<Height> heights_;  // of each member
  // Of each member: its position along u if the sensor stood still, its scan, and its time in that.
  std::vector<float> x_m_, time_s_;
  std::vector<std::int32_t> scan_;
};

}  // namespace lamina
