// Residuals of a scan's clusters against the voxel map, summed into normal equations.
// The cost is described in scan_matcher.h.
#pragma once

#include <algorithm>
#include <cstdint>
#include <vector>

#include "core/geometry/degeneracy.h"
#include "core/geometry/point_cluster.h"
#include "core/geometry/se3.h"
#include "core/map/voxel_key.h"
#include "core/map/voxel_map.h"
#include "frontend/matching/block_votes.h"
#include "frontend/matching/match_rows.h"
#include "frontend/matching/planes_instead.h"
#include "frontend/matching/seen_through.h"

namespace lamina {

struct ScanMatcherOptions;

// Squared standard deviation, m^2, of a cluster's distance from a plane with this normal in the
// LiDAR frame: what neither of them is thinner than, the plane's thickness and the cluster's own.
inline double DistanceVariance(const PointCluster& cluster, const Eigen::Vector3d& normal_lidar,
                               const Surface& surface, double floor2) {
  const double spread = normal_lidar.dot(cluster.scatter * normal_lidar) / cluster.count;
  return floor2 + static_cast<double>(surface.variance) + spread;
}

// One linearisation of the cost, H step = -g, in the tangent of core/geometry/se3.h.
struct NormalEquations {
  Matrix6d H = Matrix6d::Zero();
  Matrix6d H_rings = Matrix6d::Zero();  // the share of lines that single rings have drawn
  Vector6d g = Vector6d::Zero();
  double weight = 0.0;     // sum of the weights (1/m^2)
  double robust = 0.0;     // sum of the kernel's weights in [0, 1]
  double residual2 = 0.0;  // sum of kernel weight * distance^2
  int matched = 0;
  int matched_old = 0;  // those that weigh something, on planes that are not young
  // Along the watched directions: of all residuals / of those on planes that are not young.
  DirectionEvidence all, old;

  NormalEquations& operator+=(const NormalEquations& o);
};

// Planes that a scan meets at a pose, and whether they face a direction. In the order of the scan's
// clusters: ids of nodes are others after a map was loaded, and so would be the sums of it.
struct MetPlanes {
  struct Plane {
    VoxelMap::NodeId id = VoxelMap::kNoNode;
    const Surface* plane = nullptr;
    bool faces = false;   // the direction
    double points = 0.0;  // of the scan, by the kernel's weight
    RowSums sums;
  };
  std::vector<Plane> planes;
  BeamsOfScan beams;
};

// The planes facing a direction that the scan sees through, and the contributions of these and of
// the others that face it to the normal matrix.
struct SeenThrough {
  std::vector<VoxelMap::NodeId> planes;
  Matrix6d H = Matrix6d::Zero(), H_opaque = Matrix6d::Zero();
};

// Not thread-safe; runs on several threads, with the same bits at any number.
class MapResiduals {
 public:
  // All arguments must outlive it.
  MapResiduals(const ScanMatcherOptions& options, const VoxelMap& map,
               const std::vector<PointCluster>& clusters)
      : options_(options),
        map_(map),
        clusters_(clusters),
        places_(clusters.size()),
        surfaces_(clusters.size(), VoxelMap::kNoNode),
        planes_(clusters.size()) {}

  const VoxelMap& map() const { return map_; }

  // Whether rough leaves take part.
  bool use_rough = false;
  // Whether planes that the scan meets flatly (kFlatSine) take part.
  bool use_flat = true;

  // Evidence along the columns of *watched (scaled tangent) is gathered if it is not null.
  NormalEquations At(const SE3& T, double kernel_sigma, const Matrix6d* watched) {
    return Sum(T, kernel_sigma, watched, /*with_normal=*/true);
  }
  // The evidence alone, without the normal equations, which cost most: the rest is zero.
  NormalEquations EvidenceAt(const SE3& T, double kernel_sigma, const Matrix6d& watched) {
    return Sum(T, kernel_sigma, &watched, /*with_normal=*/false);
  }

  // Evidence that other planes, in the place of the map's surfaces, give along the columns of
  // `directions`. The object cannot be used for anything else thereafter.
  DirectionEvidence EvidenceOf(const PlanesInstead& planes, const SE3& T, double kernel_sigma,
                               const Matrix6d& directions);

  // `direction`: scaled tangent.
  MetPlanes Meet(const SE3& T, double kernel_sigma, const Vector6d& direction);
  // Which planes that face the direction the scan sees through (seen_through.h). None if the others
  // that face it have more information along it than these together with `feigned`, that of planes
  // dropped before: this is known before all are tested.
  SeenThrough FindSeenThrough(const MetPlanes& met, const Vector6d& direction,
                              double feigned) const;
  // Whether all beams start at the scan's pose: those of several sensors merged in one scan, or
  // points sampled on surfaces without occlusion, pass planes that do not face the direction as
  // well.
  bool OfOneSensor(const MetPlanes& met) const;
  // Excludes these planes from now on.
  void Drop(const std::vector<VoxelMap::NodeId>& planes);

  // Scatter of the gradient at the pose and kernel of the last At: the sum of scan_matcher.h over
  // blocks of space, without H^-1 on both sides. *step is the pose step by the votes of these
  // blocks.
  Matrix6d GradientScatter(const SE3& T, double kernel_sigma, BlockStep* step);

  // Sums for a pose step and a second step at once, which cluster i enters with shares[i].
  TwoStepRows TwoStepsAt(const SE3& T, double kernel_sigma, const std::vector<StepShares>& shares);

 private:
  // H and gradient of the clusters in a block of space, where errors are alike.
  struct Block {
    VoxelKey key = 0;
    RowSums sums;
  };
  std::vector<Block> Blocks(const SE3& T, double kernel_sigma);
  // At, with the normal equations or without.
  NormalEquations Sum(const SE3& T, double kernel_sigma, const Matrix6d* watched, bool with_normal);
  static BlockStep StepOf(const std::vector<Block>& blocks);
  // Sum of g g' over the surfaces that a block's clusters meet, g being the gradient of a surface's
  // own. At the pose of the last At.
  Matrix6d SurfaceScatter(const SE3& T, double kernel_sigma, VoxelKey block) const;
  // Looks up the surface around each cluster, unless the pose is still so near the one of the last
  // look-up that a cluster at 30 m has moved by less than a small part of a leaf. Most clusters are
  // still in the leaf in which they were then, and have no need of another.
  void Associate(const SE3& T, const Eigen::Matrix3d& R);
  bool IsDropped(VoxelMap::NodeId id) const {
    return !dropped_.empty() && std::binary_search(dropped_.begin(), dropped_.end(), id);
  }
  // Sets floor2_ and beam2_ by the thickness of the thinner ones of the planes around the scan. A
  // plane that looks thinner still does so because few points made it, or one beam.
  void FindLeastThickness();
  RowSettings SettingsAt(const SE3& T, double kernel_sigma) const;
  // Calls visit(rows, clusters, count) for the rows of the clusters in [begin, end) that meet
  // something, in their order: of many planes at a time, one for each of `count` clusters, and of
  // one rough leaf, `count` of the same cluster. `clusters` are their numbers.
  template <typename Visit>
  void ForEachRows(std::size_t begin, std::size_t end, const RowSettings& settings,
                   const Visit& visit) const;
  // A pole or an edge has no plane, but is narrow across: every narrow axis of the joint
  // distribution of cluster and leaf holds its direction. Wide axes end at the voxel's faces, not
  // at anything real, and say nothing. Returns the number of rows, at most 3.
  std::size_t MakeRoughRows(const PointCluster& cluster, VoxelMap::NodeId leaf,
                            const RowSettings& settings, MatchRow* rows) const;

  const ScanMatcherOptions& options_;
  const VoxelMap& map_;
  const std::vector<PointCluster>& clusters_;
  std::vector<LeafPlace> places_;  // of the last look-up, where there was one
  std::vector<VoxelMap::NodeId> surfaces_;
  std::vector<const Surface*> planes_;     // of those that are planar, else null
  std::vector<VoxelMap::NodeId> dropped_;  // in their order
  double floor2_ = 0.0;  // m^2: variance that no plane is believed to have less of
  double beam2_ = 0.0;   // m^2: see NormalError2
  bool associated_ = false;
  SE3 associated_at_;
};

}  // namespace lamina
