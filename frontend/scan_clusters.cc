#include "frontend/scan_clusters.h"

#include <algorithm>
#include <cmath>

#include "core/base/parallel.h"
#include "core/map/voxel_key.h"

namespace lamina {
namespace {

// Raw sums about the centre of the voxel: within half a voxel of their origin, sums in double lose
// nothing, and adding a point is ten multiplications without a division.
struct VoxelSums {
  double n = 0, x = 0, y = 0, z = 0;
  double xx = 0, xy = 0, xz = 0, yy = 0, yz = 0, zz = 0;
  double t = 0, tt = 0, tx = 0, ty = 0, tz = 0;
  VoxelKey key = 0;
};

inline void AddPoint(double x, double y, double z, double t, VoxelSums* s) {
  s->n += 1.0;
  s->x += x, s->y += y, s->z += z;
  s->xx += x * x, s->xy += x * y, s->xz += x * z;
  s->yy += y * y, s->yz += y * z, s->zz += z * z;
  s->t += t, s->tt += t * t, s->tx += t * x, s->ty += t * y, s->tz += t * z;
}

TimedCluster ToCluster(const VoxelSums& s, double leaf_size_m) {
  TimedCluster c;
  c.points.count = s.n;
  const Eigen::Vector3d mean(s.x / s.n, s.y / s.n, s.z / s.n);
  c.points.mean = VoxelCentre(s.key, leaf_size_m) + mean;
  c.points.scatter = {s.xx, s.xy, s.xz, s.yy, s.yz, s.zz};
  c.points.scatter.AddOuter(-s.n, mean);
  c.mean_time_s = s.t / s.n;
  c.time_scatter = std::max(0.0, s.tt - s.t * c.mean_time_s);
  c.point_time = Eigen::Vector3d(s.tx, s.ty, s.tz) - s.t * mean;
  return c;
}

// The sensor's poses at evenly spread instants of a scan, made once: the exponential of a twist for
// each cluster would cost more than all the rest of deskewing. Between two instants a cluster is at
// most a millisecond or so from the nearest, and is brought there to first order.
class SweepPoses {
 public:
  struct Instant {
    double time_s;
    Eigen::Matrix3d R;
    Eigen::Vector3d t;
  };

  SweepPoses(const std::vector<TimedCluster>& clusters, const Vector6d& twist) {
    const auto [first, last] = std::minmax_element(
        clusters.begin(), clusters.end(),
        [](const TimedCluster& a, const TimedCluster& b) { return a.mean_time_s < b.mean_time_s; });
    start_s_ = first->mean_time_s;
    const double span_s = last->mean_time_s - start_s_;
    const int count = span_s > 0.0 ? kInstants : 1;
    per_second_ = span_s > 0.0 ? (kInstants - 1) / span_s : 0.0;
    for (int i = 0; i < count; ++i) {
      const double time_s = start_s_ + (span_s > 0.0 ? i / per_second_ : 0.0);
      const SE3 T = TwistExp(time_s * twist);
      instants_.push_back({time_s, T.R(), T.t});
    }
  }

  const Instant& NearestTo(double time_s) const {
    return instants_[static_cast<std::size_t>((time_s - start_s_) * per_second_ + 0.5)];
  }

 private:
  static constexpr int kInstants = 128;
  double start_s_ = 0.0, per_second_ = 0.0;
  std::vector<Instant> instants_;
};

}  // namespace

std::vector<TimedCluster> BuildScanClusters(const std::vector<TimedPoint>& points,
                                            double leaf_size_m) {
  VoxelIndex index(points.size() / 8 + 64);
  std::vector<VoxelSums> sums;
  sums.reserve(points.size() / 8 + 64);
  const double inverse = 1.0 / leaf_size_m;
  // Returns come in the order of the sweep: most lie in the voxel of the last one. Nearer to its
  // faces than this, rounding decides.
  const double inside_m = 0.4999 * leaf_size_m;
  VoxelSums* last = nullptr;
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  for (const TimedPoint& point : points) {
    const Eigen::Vector3d p(point.x, point.y, point.z);
    Eigen::Vector3d d = p - centre;
    if (last == nullptr ||
        !(std::abs(d.x()) < inside_m && std::abs(d.y()) < inside_m && std::abs(d.z()) < inside_m)) {
      const Eigen::Vector3d cell = (p * inverse).array().floor();
      const VoxelKey key =
          PackVoxelKey(static_cast<std::int64_t>(cell.x()), static_cast<std::int64_t>(cell.y()),
                       static_cast<std::int64_t>(cell.z()));
      const auto fresh = static_cast<std::int32_t>(sums.size());
      const std::int32_t slot = index.FindOrInsert(key, fresh);
      if (slot == fresh) {
        sums.emplace_back();
        sums.back().key = key;
      }
      last = &sums[static_cast<std::size_t>(slot)];
      centre = (cell + Eigen::Vector3d::Constant(0.5)) * leaf_size_m;
      d = p - centre;
    }
    AddPoint(d.x(), d.y(), d.z(), point.time_s, last);
  }
  std::vector<TimedCluster> clusters;
  clusters.reserve(sums.size());
  for (const VoxelSums& s : sums) clusters.push_back(ToCluster(s, leaf_size_m));
  return clusters;
}

std::vector<TimedCluster> MergeClusters(const std::vector<TimedCluster>& clusters,
                                        double leaf_size_m, std::vector<std::size_t>* group_of) {
  VoxelIndex index(clusters.size() / 2 + 64);
  std::vector<TimedCluster> merged;
  for (const TimedCluster& cluster : clusters) {
    const auto group = static_cast<std::size_t>(
        index.FindOrInsert(VoxelKeyOf(cluster.points.mean, 1.0 / leaf_size_m),
                           static_cast<std::int32_t>(merged.size())));
    if (group == merged.size()) merged.emplace_back();
    merged[group] += cluster;
    if (group_of != nullptr) group_of->push_back(group);
  }
  return merged;
}

std::vector<std::vector<TimedPoint>> GroupByCluster(const std::vector<TimedPoint>& points,
                                                    double leaf_size_m) {
  VoxelIndex index(points.size() / 8 + 64);
  std::vector<std::vector<TimedPoint>> groups;
  for (const TimedPoint& point : points) {
    const VoxelKey key = VoxelKeyOf(Eigen::Vector3d(point.x, point.y, point.z), 1.0 / leaf_size_m);
    const auto slot =
        static_cast<std::size_t>(index.FindOrInsert(key, static_cast<std::int32_t>(groups.size())));
    if (slot == groups.size()) groups.emplace_back();
    groups[slot].push_back(point);
  }
  return groups;
}

std::vector<PointCluster> DeskewClusters(const std::vector<TimedCluster>& clusters,
                                         const Vector6d& twist) {
  std::vector<PointCluster> result(clusters.size());
  if (clusters.empty()) return result;
  const SweepPoses sweep(clusters, twist);
  ParallelChunks(clusters.size(), 2048, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const auto& [time_s, R, t] = sweep.NearestTo(clusters[i].mean_time_s);
      result[i] = clusters[i].DeskewedTo(time_s, twist).Moved(R, t);
    }
  });
  return result;
}

bool AnyTimed(const std::vector<TimedCluster>& clusters) {
  return std::any_of(clusters.begin(), clusters.end(), [](const TimedCluster& c) {
    return c.time_scatter > 0.0 || c.mean_time_s != 0.0;
  });
}

}  // namespace lamina
