#include "frontend/scan/scan_clusters.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

#include "core/base/parallel.h"
#include "core/base/processor.h"
#include "core/geometry/cluster_lanes.h"
#include "core/map/voxel_key.h"

namespace lamina {
namespace {

// Raw sums about the centre of the voxel: within half a voxel of their origin, sums in double lose
// nothing, and adding a point is a dozen multiplications without a division.
// Aligned as registers of four numbers are loaded.
struct alignas(32) VoxelSums {
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

// x y z t
[[gnu::always_inline]] inline void ReadPoint(const TimedPoint& point, Four* to) {
  static_assert(sizeof(TimedPoint) == 4 * sizeof(float));
  using TwoFloats = float __attribute__((vector_size(8)));
  using Two = double __attribute__((vector_size(16)));
  TwoFloats xy, zt;
  std::memcpy(&xy, &point.x, sizeof(xy));
  std::memcpy(&zt, &point.z, sizeof(zt));
  const Two a = __builtin_convertvector(xy, Two), b = __builtin_convertvector(zt, Two);
  *to = Four{a[0], a[1], b[0], b[1]};
}

// Whether the size of each number is below its bound; false for NaN.
[[gnu::always_inline]] inline bool AllBelow(const Four& v, const Four& bounds) {
  const FourIntegers no_sign = FourIntegers{} + std::numeric_limits<std::int64_t>::max();
  const auto size = reinterpret_cast<Four>(reinterpret_cast<FourIntegers>(v) & no_sign);
  FourIntegers below = size < bounds;
  below &= __builtin_shuffle(below, FourIntegers{2, 3, 0, 1});
  return (below[0] & below[1]) != 0;
}

// Adds points from the i-th on, up to the first one that is not within `inside` of the centre (x y
// z t); the i-th is added in any case. Returns where that is. The sums stay in registers meanwhile.
[[gnu::always_inline]] inline std::size_t AddWhileInside(const std::vector<TimedPoint>& points,
                                                         std::size_t i, const Four& centre,
                                                         const Four& inside, VoxelSums* sums) {
  const TimedPoint* point = points.data() + i;
  const TimedPoint* const end = points.data() + points.size();
  Four first = sums->first, squares = sums->squares, next = sums->next, across = sums->across;
  double n = sums->n;
  Four v;
  ReadPoint(*point, &v);
  v -= centre;
  do {
    n += 1.0;
    first += v;
    squares += v * v;
    next += v * __builtin_shuffle(v, FourIntegers{1, 2, 3, 0});
    across += v * __builtin_shuffle(v, FourIntegers{2, 3, 0, 1});
    if (++point == end) break;
    ReadPoint(*point, &v);
    v -= centre;
  } while (AllBelow(v, inside));
  sums->first = first, sums->squares = squares, sums->next = next, sums->across = across;
  sums->n = n;
  return static_cast<std::size_t>(point - points.data());
}

// The sums of each voxel, in the order in which the points first met the voxels.
LAMINA_FOR_EACH_PROCESSOR
void SumByVoxel(const std::vector<TimedPoint>& points, double leaf_size_m,
                std::vector<VoxelSums>* sums) {
  VoxelIndex index(points.size() / 8 + 64);
  const double inverse = 1.0 / leaf_size_m;
  // Returns come in the order of the sweep: most lie in the voxel of the last one. Nearer to its
  // faces than this, rounding decides.
  const double inside_m = 0.4999 * leaf_size_m;
  const Four inside = {inside_m, inside_m, inside_m, std::numeric_limits<double>::infinity()};
  for (std::size_t i = 0; i < points.size();) {
    const double p[3] = {points[i].x, points[i].y, points[i].z};
    Four centre = {0, 0, 0, 0};
    std::int64_t cell[3];
    for (int axis = 0; axis < 3; ++axis) {
      const double floor = std::floor(p[axis] * inverse);
      cell[axis] = static_cast<std::int64_t>(floor);
      centre[axis] = (floor + 0.5) * leaf_size_m;
    }
    const VoxelKey key = PackVoxelKey(cell[0], cell[1], cell[2]);
    const auto slot =
        static_cast<std::size_t>(index.FindOrInsert(key, static_cast<std::int32_t>(sums->size())));
    if (slot == sums->size()) {
      sums->emplace_back();
      sums->back().key = key;
    }
    i = AddWhileInside(points, i, centre, inside, &(*sums)[slot]);
  }
}

// The first and the last instant of a scan that is not empty.
std::pair<double, double> SpanOf(const std::vector<TimedCluster>& clusters) {
  double first_s = clusters.front().mean_time_s, last_s = first_s;
  for (const TimedCluster& cluster : clusters) {
    first_s = std::min(first_s, cluster.mean_time_s);
    last_s = std::max(last_s, cluster.mean_time_s);
  }
  return {first_s, last_s};
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
    double twist[8];  // rotation in 0 to 2, translation in 4 to 6: as a vector register takes them
  };

  SweepPoses(const std::vector<TimedCluster>& clusters, const SweepMotion& motion) {
    const auto [first_s, last_s] = SpanOf(clusters);
    start_s_ = first_s;
    const double span_s = last_s - start_s_;
    const int count = span_s > 0.0 ? kInstants : 1;
    per_second_ = span_s > 0.0 ? (kInstants - 1) / span_s : 0.0;
    for (int i = 0; i < count; ++i) {
      const double time_s = start_s_ + (span_s > 0.0 ? i / per_second_ : 0.0);
      const SE3 T = motion.PoseAt(time_s);
      const Vector6d xi = motion.TwistAt(time_s);
      instants_.push_back(
          {time_s, T.R(), T.t, {xi(0), xi(1), xi(2), 0.0, xi(3), xi(4), xi(5), 0.0}});
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

// To the nearest instant, and moved from there.
LAMINA_FOR_EACH_PROCESSOR
void DeskewRange(const TimedCluster* from, std::size_t count, const SweepPoses& sweep,
                 const SweepMotion& sweep_motion, PointCluster* to) {
  const Vector6d& a6 = sweep_motion.acceleration;
  const double turn[3] = {a6(0), a6(1), a6(2)}, way[3] = {a6(3), a6(4), a6(5)};
  TimedCluster rest_in[4];
  PointCluster rest_out[4];
  for (std::size_t i = 0; i < count; i += 4) {
    const bool last = i + 4 > count;
    if (last) std::fill(std::copy(from + i, from + count, rest_in), rest_in + 4, from[i]);
    const TimedCluster* const in = last ? rest_in : from + i;
    PointCluster* const out = last ? rest_out : to + i;
    const SweepPoses::Instant* const near[4] = {
        &sweep.NearestTo(in[0].mean_time_s), &sweep.NearestTo(in[1].mean_time_s),
        &sweep.NearestTo(in[2].mean_time_s), &sweep.NearestTo(in[3].mean_time_s)};
    const Eigen::Matrix3d* const R[4] = {&near[0]->R, &near[1]->R, &near[2]->R, &near[3]->R};
    const Eigen::Vector3d* const t[4] = {&near[0]->t, &near[1]->t, &near[2]->t, &near[3]->t};
    ClusterLanes lanes;
    lanes.Load(NumbersOf(in[0].points), NumbersOf(in[1].points), NumbersOf(in[2].points),
               NumbersOf(in[3].points));
    const double* const times[4] = {&in[0].time_scatter, &in[1].time_scatter, &in[2].time_scatter,
                                    &in[3].time_scatter};
    Four time[4];  // scatter and point_time
    LoadColumns(times, time);
    const Four* const k = time + 1;
    const Four offset = {in[0].mean_time_s - near[0]->time_s, in[1].mean_time_s - near[1]->time_s,
                         in[2].mean_time_s - near[2]->time_s, in[3].mean_time_s - near[3]->time_s};
    const double* const twists[4] = {near[0]->twist, near[1]->twist, near[2]->twist,
                                     near[3]->twist};
    Four w[4], v[4];
    LoadColumns(twists, w);
    const double* const ways[4] = {twists[0] + 4, twists[1] + 4, twists[2] + 4, twists[3] + 4};
    LoadColumns(ways, v);
    const Four w2 = w[0] * w[0] + w[1] * w[1] + w[2] * w[2];
    const Four each = 1.0 / lanes.count;
    const Four spread2 = time[0] * each;
    const Four second = 0.5 * (spread2 * (1.0 - 0.15 * w2 * spread2) + offset * offset);
    Four c[3], change[3];
#pragma GCC unroll 3
    for (int a = 0; a < 3; ++a) {
      const int b = (a + 1) % 3, d = (a + 2) % 3;
      c[a] = w[b] * lanes.mean[d] - w[d] * lanes.mean[b] + v[a];
      change[a] = turn[b] * lanes.mean[d] - turn[d] * lanes.mean[b] + way[a];
    }
#pragma GCC unroll 3
    for (int a = 0; a < 3; ++a) {
      const int b = (a + 1) % 3, d = (a + 2) % 3;
      lanes.mean[a] += offset * c[a] + (w[b] * k[d] - w[d] * k[b]) * each +
                       second * (w[b] * c[d] - w[d] * c[b] + change[a]);
    }
    lanes.scatter[0] += c[0] * (2.0 * k[0] + time[0] * c[0]);
    lanes.scatter[1] += c[0] * k[1] + c[1] * (k[0] + time[0] * c[0]);
    lanes.scatter[2] += c[0] * k[2] + c[2] * (k[0] + time[0] * c[0]);
    lanes.scatter[3] += c[1] * (2.0 * k[1] + time[0] * c[1]);
    lanes.scatter[4] += c[1] * k[2] + c[2] * (k[1] + time[0] * c[1]);
    lanes.scatter[5] += c[2] * (2.0 * k[2] + time[0] * c[2]);
    MotionLanes motion;
    motion.Load(R, t);
    lanes.Move(motion);
    lanes.Store(NumbersOf(out[0]), NumbersOf(out[1]), NumbersOf(out[2]), NumbersOf(out[3]));
    if (last) std::copy(rest_out, rest_out + (count - i), to + i);
  }
}

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
    TimedCluster& group = index.Gather(VoxelKeyOf(cluster.points.mean, 1.0 / leaf_size_m), &merged);
    group += cluster;
    if (group_of != nullptr) group_of->push_back(static_cast<std::size_t>(&group - merged.data()));
  }
  return merged;
}

std::vector<std::vector<TimedPoint>> GroupByCluster(const std::vector<TimedPoint>& points,
                                                    double leaf_size_m) {
  VoxelIndex index(points.size() / 8 + 64);
  std::vector<std::vector<TimedPoint>> groups;
  for (const TimedPoint& point : points) {
    const VoxelKey key = VoxelKeyOf(Eigen::Vector3d(point.x, point.y, point.z), 1.0 / leaf_size_m);
    index.Gather(key, &groups).push_back(point);
  }
  return groups;
}

std::vector<PointCluster> DeskewClusters(const std::vector<TimedCluster>& clusters,
                                         const SweepMotion& motion) {
  std::vector<PointCluster> result;
  DeskewClusters(clusters, motion, &result);
  return result;
}

void DeskewClusters(const std::vector<TimedCluster>& clusters, const SweepMotion& motion,
                    std::vector<PointCluster>* result) {
  result->resize(clusters.size());
  if (clusters.empty()) return;
  const SweepPoses sweep(clusters, motion);
  ParallelChunks(clusters.size(), 2048, [&](std::size_t begin, std::size_t end) {
    DeskewRange(clusters.data() + begin, end - begin, sweep, motion, result->data() + begin);
  });
}

std::vector<PointCluster> Undeskewed(const std::vector<TimedCluster>& clusters) {
  std::vector<PointCluster> points;
  points.reserve(clusters.size());
  for (const TimedCluster& cluster : clusters) points.push_back(cluster.points);
  return points;
}

StampNs CentreTimes(std::vector<TimedCluster>* clusters) {
  if (clusters->empty()) return 0;
  const auto [first_s, last_s] = SpanOf(*clusters);
  constexpr double kNsPerS = 1e9;
  const auto middle_ns = static_cast<StampNs>(std::llround(kNsPerS * 0.5 * (first_s + last_s)));
  for (TimedCluster& cluster : *clusters)
    cluster.mean_time_s -= static_cast<double>(middle_ns) / kNsPerS;
  return middle_ns;
}

double SweepLength(const std::vector<TimedCluster>& clusters) {
  if (clusters.empty()) return 0.0;
  const auto [first_s, last_s] = SpanOf(clusters);
  return last_s - first_s;
}

bool AnyTimed(const std::vector<TimedCluster>& clusters) {
  return std::any_of(clusters.begin(), clusters.end(),
                     [](const TimedCluster& c) { return c.Timed(); });
}

}  // namespace lamina
