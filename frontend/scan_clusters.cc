#include "frontend/scan_clusters.h"

#include <algorithm>
#include <cmath>

#include "core/base/parallel.h"
#include "core/base/processor.h"
#include "core/map/voxel_key.h"

namespace lamina {
namespace {

using FourPlaces = std::int64_t __attribute__((vector_size(32)));

// Raw sums about the centre of the voxel: within half a voxel of their origin, sums in double lose
// nothing, and adding a point is a dozen multiplications without a division.
struct VoxelSums {
  Four first = {0, 0, 0, 0};    // x y z t
  Four squares = {0, 0, 0, 0};  // xx yy zz tt
  Four next = {0, 0, 0, 0};     // xy yz zt tx
  Four across = {0, 0, 0, 0};   // xz yt zx ty
  double n = 0.0;
  VoxelKey key = 0;
};

TimedCluster ToCluster(const VoxelSums& s, double leaf_size_m) {
  TimedCluster c;
  c.points.count = s.n;
  const Eigen::Vector3d mean(s.first[0] / s.n, s.first[1] / s.n, s.first[2] / s.n);
  c.points.mean = VoxelCentre(s.key, leaf_size_m) + mean;
  c.points.scatter = {s.squares[0], s.next[0], s.across[0], s.squares[1], s.next[1], s.squares[2]};
  c.points.scatter.AddOuter(-s.n, mean);
  const double t = s.first[3];
  c.mean_time_s = t / s.n;
  c.time_scatter = std::max(0.0, s.squares[3] - t * c.mean_time_s);
  c.point_time = Eigen::Vector3d(s.next[3], s.across[3], s.next[2]) - t * mean;
  return c;
}

// The sums of each voxel, in the order in which the points first met the voxels.
LAMINA_FOR_EACH_PROCESSOR
void SumByVoxel(const std::vector<TimedPoint>& points, double leaf_size_m,
                std::vector<VoxelSums>* sums) {
  VoxelIndex index(points.size() / 8 + 64);
  const double inverse = 1.0 / leaf_size_m;
  // Returns come in the order of the sweep: most lie in the voxel of the last one, whose sums stay
  // in registers. Nearer to its faces than this, rounding decides.
  const double inside_m = 0.4999 * leaf_size_m;
  std::size_t slot = 0;
  VoxelSums s;
  double centre[3] = {0.0, 0.0, 0.0};
  bool any = false;
  for (const TimedPoint& point : points) {
    const double p[3] = {point.x, point.y, point.z};
    double d[3] = {p[0] - centre[0], p[1] - centre[1], p[2] - centre[2]};
    if (!any ||
        !(std::abs(d[0]) < inside_m && std::abs(d[1]) < inside_m && std::abs(d[2]) < inside_m)) {
      if (any) (*sums)[slot] = s;
      any = true;
      std::int64_t cell[3];
      for (int axis = 0; axis < 3; ++axis) {
        const double floor = std::floor(p[axis] * inverse);
        cell[axis] = static_cast<std::int64_t>(floor);
        centre[axis] = (floor + 0.5) * leaf_size_m;
        d[axis] = p[axis] - centre[axis];
      }
      const VoxelKey key = PackVoxelKey(cell[0], cell[1], cell[2]);
      slot = static_cast<std::size_t>(
          index.FindOrInsert(key, static_cast<std::int32_t>(sums->size())));
      if (slot == sums->size()) {
        sums->emplace_back();
        sums->back().key = key;
      }
      s = (*sums)[slot];
    }
    const Four v = {d[0], d[1], d[2], point.time_s};
    s.n += 1.0;
    s.first += v;
    s.squares += v * v;
    s.next += v * __builtin_shuffle(v, FourPlaces{1, 2, 3, 0});
    s.across += v * __builtin_shuffle(v, FourPlaces{2, 3, 0, 1});
  }
  if (any) (*sums)[slot] = s;
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

  SweepPoses(const std::vector<TimedCluster>& clusters, const SweepMotion& motion) {
    const auto [first, last] = std::minmax_element(
        clusters.begin(), clusters.end(),
        [](const TimedCluster& a, const TimedCluster& b) { return a.mean_time_s < b.mean_time_s; });
    start_s_ = first->mean_time_s;
    const double span_s = last->mean_time_s - start_s_;
    const int count = span_s > 0.0 ? kInstants : 1;
    per_second_ = span_s > 0.0 ? (kInstants - 1) / span_s : 0.0;
    for (int i = 0; i < count; ++i) {
      const double time_s = start_s_ + (span_s > 0.0 ? i / per_second_ : 0.0);
      const SE3 T = motion.PoseAt(time_s);
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
  std::vector<VoxelSums> sums;
  sums.reserve(points.size() / 8 + 64);
  SumByVoxel(points, leaf_size_m, &sums);
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
                                         const SweepMotion& motion) {
  std::vector<PointCluster> result(clusters.size());
  if (clusters.empty()) return result;
  const SweepPoses sweep(clusters, motion);
  ParallelChunks(clusters.size(), 2048, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const auto& [time_s, R, t] = sweep.NearestTo(clusters[i].mean_time_s);
      result[i] = clusters[i].DeskewedTo(time_s, motion).Moved(R, t);
    }
  });
  return result;
}

StampNs CentreTimes(std::vector<TimedCluster>* clusters) {
  if (clusters->empty()) return 0;
  const auto [first, last] = std::minmax_element(
      clusters->begin(), clusters->end(),
      [](const TimedCluster& a, const TimedCluster& b) { return a.mean_time_s < b.mean_time_s; });
  const double middle_s = 0.5 * (first->mean_time_s + last->mean_time_s);
  constexpr double kNsPerS = 1e9;
  const auto middle_ns = static_cast<StampNs>(std::llround(kNsPerS * middle_s));
  for (TimedCluster& cluster : *clusters)
    cluster.mean_time_s -= static_cast<double>(middle_ns) / kNsPerS;
  return middle_ns;
}

bool AnyTimed(const std::vector<TimedCluster>& clusters) {
  return std::any_of(clusters.begin(), clusters.end(), [](const TimedCluster& c) {
    return c.time_scatter > 0.0 || c.mean_time_s != 0.0;
  });
}

}  // namespace lamina
