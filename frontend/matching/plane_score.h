// How well clusters of a scan fit the map's planes at one pose, and at which of two poses better.
#pragma once

#include <algorithm>
#include <utility>
#include <vector>

#include "core/geometry/point_cluster.h"
#include "core/geometry/robust_kernel.h"
#include "core/geometry/se3.h"
#include "core/map/voxel_map.h"
#include "frontend/matching/block_votes.h"
#include "frontend/matching/line_of_sight.h"
#include "frontend/matching/planes_instead.h"

namespace lamina {

// SightWeight times (GemanMcClureWeight((distance / scale_m)^2) - chance) of a cluster's mean and
// the plane around it. A plane that holds the line of sight says nothing, neither for a pose nor
// against it: in grass and foliage the sheets of a scan's own beams are about the next one as well,
// most of all where that is in its right place.
class PlaneScore {
 public:
  static constexpr double kNone = -1.0;

  // `chance`: the fit that a plane has anywhere, in [0, 0.5].
  PlaneScore(const SE3& T_world_lidar, const VoxelMap& map, double scale_m, double chance = 0.0)
      : R_(T_world_lidar.R()),
        t_(T_world_lidar.t),
        map_(map),
        inverse2_(1.0 / (scale_m * scale_m)),
        chance_(chance) {}

  // In [-chance, 1 - chance]; kNone where there is no plane.
  double Of(const PointCluster& cluster) const {
    const Eigen::Vector3d p = InMap(cluster);
    const Surface* plane = map_.PlaneAt(p);
    return plane == nullptr ? kNone : Fit(*plane, p);
  }
  // A fit, or 0 for a cluster without a plane.
  static double OrNothing(double fit) { return fit > kNone ? fit : 0.0; }
  // Calls visit with Of() of every `stride`-th one of many clusters, in their order.
  template <typename Visit>
  void OfEach(const std::vector<PointCluster>& clusters, std::size_t stride,
              const Visit& visit) const {
    constexpr std::size_t kTogether = 64;
    LeafPlace leaves[kTogether];
    for (std::size_t first = 0; first < clusters.size(); first += kTogether * stride) {
      const std::size_t count = std::min(kTogether, (clusters.size() - 1 - first) / stride + 1);
      map_.PlacesOf(&clusters[first], stride, count, R_, t_, leaves);
      for (std::size_t k = 0; k < count; ++k) {
        const Surface* plane = map_.PlaneAt(leaves[k]);
        visit(plane == nullptr ? kNone : On(*plane, clusters[first + k * stride]));
      }
    }
  }

  // The cluster's mean in the map's frame.
  Eigen::Vector3d InMap(const PointCluster& cluster) const { return R_ * cluster.mean + t_; }

  // The fit to this plane, as if it extended as far as the cluster.
  double On(const Surface& plane, const PointCluster& cluster) const {
    return Fit(plane, InMap(cluster));
  }

 private:
  double Fit(const Surface& plane, const Eigen::Vector3d& p) const {
    const double distance = plane.Distance(p);
    return SightWeight(plane, plane.normal.cast<double>(), p - t_) *
           (GemanMcClureWeight(distance * distance * inverse2_) - chance_);
  }

  Eigen::Matrix3d R_;
  Eigen::Vector3d t_;
  const VoxelMap& map_;
  double inverse2_, chance_;
};

// By how many standard deviations of the votes of blocks (block_votes.h) scans fit the map better
// at one of two places. A cluster that meets a plane at one of them alone may be of a surface that
// the map has not seen so far: where that plane, extended, fits it at the other place as well, it
// says nothing, and elsewhere half of what one that misses a plane says. `instead`: of the planes
// that stand in for the map's, if there are any.
class PlaceVotes {
 public:
  PlaceVotes(const VoxelMap& map, double scale_m, PlanesInstead instead = nullptr)
      : map_(map), scale_m_(scale_m), instead_(std::move(instead)) {}

  // A scan at either pose; its blocks are those of a frame in which the sensor is at `T`.
  void Add(const std::vector<PointCluster>& clusters, const SE3& ours, const SE3& theirs,
           const SE3& T = SE3()) {
    constexpr double kNoPlane = 0.5;
    const PlaneScore our_score(ours, map_, scale_m_), their_score(theirs, map_, scale_m_);
    const auto fit = [&](const PlaneScore& score, const Surface* plane, const Surface* other,
                         const PointCluster& cluster) {
      if (plane != nullptr) return score.On(*plane, cluster);
      return std::max(kNoPlane, score.On(*other, cluster));
    };
    for (const PointCluster& cluster : clusters) {
      const Surface* our_plane = PlaneAt(our_score.InMap(cluster));
      const Surface* their_plane = PlaneAt(their_score.InMap(cluster));
      if (our_plane == nullptr && their_plane == nullptr) continue;
      differences_.Add(T * cluster.mean, fit(our_score, our_plane, their_plane, cluster) -
                                             fit(their_score, their_plane, our_plane, cluster));
    }
  }
  // Positive where the first place is better.
  double Sigmas() const { return differences_.Sigmas(); }

 private:
  const Surface* PlaneAt(const Eigen::Vector3d& p) const {
    return PlaneOf(map_, map_.FindSurface(p), instead_).plane;
  }

  const VoxelMap& map_;
  double scale_m_;
  PlanesInstead instead_;
  BlockDifferences differences_;
};

}  // namespace lamina
