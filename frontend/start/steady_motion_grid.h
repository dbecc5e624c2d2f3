// The voxels of one grid in which steady motions are judged (steady_motion.h).
//
// A motion moves clusters along u only. The position of a cluster across u, and so its column of
// voxels along u, is the same for every motion: clusters are sorted by column once, and a motion is
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
  // A cluster in the frame of the axes, the same for all grids.
  struct TurnedCluster {
    Eigen::Vector3d mean;
    Eigen::Matrix3f covariance;
    float points = 0.0F, time_s = 0.0F;
    std::int32_t scan = 0;
  };
  // The clusters of all scans, one scan after the other.
  static std::vector<TurnedCluster> Turn(const SteadyMotionAxes& axes,
                                         const std::vector<SteadyScan>& scans);
  // `is_in_space`: for each cluster, whether it is judged in 3D, not in plan. Clusters judged in 3D
  // get voxels separate from those judged in plan. `shift`: of the grid, in voxels.
  SteadyMotionGrid(double voxel_size_m, double noise_m, const std::vector<TurnedCluster>& clusters,
                   const std::vector<char>& is_in_space, const Eigen::Vector3d& shift);

  // How voxels of few points count. kBlurred: as 1 m thick, so that a motion that puts the points
  // of all scans together is sharper. kTellNothing: with a neutral thickness. If rays repeat from
  // scan to scan, points on a wall along u coincide under the assumption that the sensor stands and
  // spread if it is assumed to move, whichever is true.
  enum class Sparse { kBlurred, kTellNothing };
  // The first scan that sees a voxel; `others` is not 0 if further scans do.
  struct VoxelScans {
    std::int32_t first = 0, others = 0;
  };
  // Memory that one judgement leaves to the next.
  struct Scratch {
    std::vector<float> x_m;           // of each cluster, from the middle of its voxel along u
    std::vector<std::int32_t> along;  // number of that voxel along u, later its place in `plans`
    // Index among all voxels of the last voxel at each number along u: of the column that is
    // summed, or of an earlier one.
    std::vector<std::int32_t> place_at;
    // For the voxels of a batch of columns: sums about the middle of each, the scans that see it,
    // its sharpness, and the indices of those that are not sparse.
    std::vector<VoxelPlan> plans;
    std::vector<VoxelHeights> heights;  // of columns in space alone
    std::vector<VoxelScans> scans;
    std::vector<float> sharpness;
    std::vector<std::int32_t> dense;
  };

  // Sums over several grids under one way.
  struct Evidence {
    std::vector<double> blocks;  // L_b of each
    double shared = 0.0;         // points in voxels that several scans see
  };
  // Values of the clusters of all scans, reordered as this grid has its members.
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
  // The range of members of a batch.
  std::size_t Begin(const Batch& batch) const { return columns_[batch.begin].begin; }
  std::size_t End(const Batch& batch) const { return columns_[batch.end - 1].end; }
  bool InSpace(const Batch& batch) const { return columns_[batch.begin].in_space; }

  // Finds the voxel numbers along u of the members [begin, end). Returns how many there are.
  std::size_t FindAlong(const WayAlong& way, std::size_t begin, std::size_t end,
                        Scratch* scratch) const;
  // Appends the members of a column with this middle.
  void AddMembers(const std::vector<TurnedCluster>& clusters, const std::int32_t* of,
                  std::size_t count, const Eigen::Vector3d& middle, const Eigen::Vector3d& shift_m);
  // Splits the columns into batches. The first `few` columns are those of Share::kFew.
  void MakeBatches(std::size_t few);
  // Sums the members of a batch by voxel; `before` voxels precede it. Returns how many it has.
  std::size_t SumVoxels(const Batch& batch, std::int32_t before, Scratch* scratch) const;
  void AddHeights(const Batch& batch, std::size_t voxels, Scratch* scratch) const;
  // Finds the sharpness of so many voxels; adds the points in voxels that several scans see.
  void Sharpen(std::size_t voxels, bool in_space, float sparse, Scratch* scratch,
               Evidence* sums) const;

  float voxel_size_m_, inverse_size_;
  double noise2_;
  std::vector<Column> columns_;
  std::vector<Batch> batches_;
  std::size_t few_batches_ = 0;
  // For each member: sums about its position along u and the middle of its column, and its number
  // among the clusters of all scans.
  std::vector<VoxelPlan> members_;
  std::vector<std::int32_t> cluster_;
  std::vector<VoxelHeights> heights_;  // of each member
  // For each member: its position along u if the sensor stood still, its scan, and its time in
  // that.
  std::vector<float> x_m_, time_s_;
  std::vector<std::int32_t> scan_;
};

}  // namespace lamina
