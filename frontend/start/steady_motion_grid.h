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
#include "frontend/start/voxel_sharpness.h"

namespace lamina {

// Orthonormal; along and across span the plan.
struct SteadyMotionAxes {
  Eigen::Vector3d along, across, up;
};

// Constant once it is made: several threads may use one, each with a scratch of its own.
class SteadyMotionGrid {
 public:
  // A cluster along the axes, as all grids have it: its sums, and what it is of.
  struct TurnedCluster {
    Eigen::Vector3d mean;
    Eigen::Matrix3f covariance;
    float points = 0.0F, time_s = 0.0F;
    std::int32_t scan = 0;
  };
  // Those of all scans, one scan after the other.
  static std::vector<TurnedCluster> Turn(const SteadyMotionAxes& axes,
                                         const std::vector<SteadyScan>& scans);
  // `is_in_space`, of each cluster: whether it is judged there, not in the plan. What is has voxels
  // of its own. `shift`: of the grid, in voxels.
  SteadyMotionGrid(double voxel_size_m, double noise_m, const std::vector<TurnedCluster>& clusters,
                   const std::vector<char>& is_in_space, const Eigen::Vector3d& shift);

  // Voxels of few points. Blurred: as of 1 m, so that what puts the points of all scans together is
  // sharper. Rays that are the same in each scan meet a wall along u in the same spots if the
  // sensor stands, and in others where it moves, whichever is true: then they tell nothing.
  enum class Sparse { kBlurred, kTellNothing };
  // The first scan that sees a voxel, and not 0 if further ones do.
  struct VoxelScans {
    std::int32_t first = 0, others = 0;
  };
  // Memory that one judgement leaves to the next.
  struct Scratch {
    std::vector<float> x_m;           // of each cluster, from the middle of its voxel along u
    std::vector<std::int32_t> along;  // number of that voxel along u, later its place in `plans`
    // The place among all voxels at each number along u: in the column that is summed, or in one
    // before.
    std::vector<std::int32_t> place_at;
    // Of a batch of columns: sums about the middle of each voxel, the scans that see it, what is
    // found of it, and which of them are not sparse.
    std::vector<VoxelPlan> plans;
    std::vector<VoxelHeights> heights;  // of columns in space alone
    std::vector<VoxelScans> scans;
    std::vector<float> sharpness;
    std::vector<std::int32_t> dense;
  };

  // What several grids say of one way.
  struct Evidence {
    std::vector<double> blocks;  // L_b of each
    double shared = 0.0;         // points in voxels that several scans see
  };
  // What belongs to the clusters of all scans, in the order in which this grid has them.
  std::vector<std::int32_t> InOrder(const std::vector<std::int32_t>& of_clusters) const;
  // Which columns are judged: a few of them, evenly spread, the others, or all.
  enum class Share { kFew, kOthers, kAll };
  // Adds, under this way, n_i (-1/2 log(lambda_i + s^2)) of each cluster i to the sum of its block.
  // `blocks`: InOrder.
  void AddSharpness(const WayAlong& way, const std::vector<std::int32_t>& blocks, Sparse few,
                    Share share, Scratch* scratch, Evidence* sums) const;
  // How many points of a share are in each of so many blocks.
  std::vector<double> PointsOf(Share share, const std::vector<std::int32_t>& blocks,
                               std::size_t count) const;
  // Points in voxels that hold few, under this way.
  double SparsePoints(const WayAlong& way, Scratch* scratch) const;

 private:
  // Clusters [begin, end) of the sorted ones.
  struct Column {
    std::size_t begin = 0, end = 0;
    bool in_space = false;
  };
  // Columns [begin, end) that are judged together, of one kind.
  struct Batch {
    std::size_t begin = 0, end = 0;
  };
  // The batches of a share.
  Batch BatchesOf(Share share) const;
  // Of their clusters.
  std::size_t Begin(const Batch& batch) const { return columns_[batch.begin].begin; }
  std::size_t End(const Batch& batch) const { return columns_[batch.end - 1].end; }
  bool InSpace(const Batch& batch) const { return columns_[batch.begin].in_space; }

  // Of the clusters [begin, end). Returns how many numbers along u there are.
  std::size_t FindAlong(const WayAlong& way, std::size_t begin, std::size_t end,
                        Scratch* scratch) const;
  // Of a column with this middle, at the end of all.
  void AddMembers(const std::vector<TurnedCluster>& clusters, const std::int32_t* of,
                  std::size_t count, const Eigen::Vector3d& middle, const Eigen::Vector3d& shift_m);
  // The batches that the columns are taken in. The first so many columns are the few.
  void MakeBatches(std::size_t few);
  // So many voxels were summed before; returns how many there are in this batch.
  std::size_t SumVoxels(const Batch& batch, std::int32_t before, Scratch* scratch) const;
  void AddHeights(const Batch& batch, std::size_t voxels, Scratch* scratch) const;
  // Of so many voxels; adds what is shared.
  void Sharpen(std::size_t voxels, bool in_space, float sparse, Scratch* scratch,
               Evidence* sums) const;

  float voxel_size_m_, inverse_size_;
  double noise2_;
  std::vector<Column> columns_;
  std::vector<Batch> batches_;
  std::size_t few_batches_ = 0;
  // Of each member: sums about where it is along u and the middle of its column, and its number
  // among the clusters of all scans.
  std::vector<VoxelPlan> members_;
  std::vector<std::int32_t> cluster_;
  std::vector<VoxelHeights> heights_;  // of each member
  // Of each member: its position along u if the sensor stood still, its scan, and its time in that.
  std::vector<float> x_m_, time_s_;
  std::vector<std::int32_t> scan_;
};

}  // namespace lamina
