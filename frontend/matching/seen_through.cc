#include "frontend/matching/seen_through.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

#include "core/base/processor.h"
#include "frontend/matching/map_residuals.h"

namespace lamina {
namespace {

// A plane as the sensor sees it. With n the normal towards the sensor, h the sensor's distance, s
// the vector from the mean to the sensor and v_k = u_k / sqrt(l_k): a ray r ends h + n.r above the
// plane, and crosses it at s - h r / (n.r). Both are tested without a division,
//
//     h + n.r < -0.2,    sum_k (v_k.s n.r - h v_k.r)^2 < 4 (n.r)^2.
struct SeenPlane {
  float n[3], v1[3], v2[3];
  float h, v1_s, v2_s;
};

// A step, a frame or an error of the range puts points behind a surface by less than kBehindM.
constexpr float kBehindM = 0.2F, kSigmas2 = 4.0F;

void Store(const Eigen::Vector3d& from, float* to) {
  for (int k = 0; k < 3; ++k) to[k] = static_cast<float>(from(k));
}

SeenPlane AsSeen(const Surface& plane, const PointCluster& members, const Eigen::Vector3d& sensor) {
  constexpr double kLeastVariance = 1e-8;
  const Eigen::Vector3d s = sensor - members.mean;
  Eigen::Vector3d n = plane.normal.cast<double>();
  if (n.dot(s) < 0.0) n = -n;
  // Along the plane: the last axis is the normal.
  const Eigen3 eigen = EigenDecompose(members.Covariance());
  const auto axis = [&](Eigen::Index k) -> Eigen::Vector3d {
    return eigen.u.col(k) / std::sqrt(std::max(eigen.l(k), kLeastVariance));
  };
  const Eigen::Vector3d v1 = axis(0), v2 = axis(1);
  SeenPlane seen{};
  Store(n, seen.n);
  Store(v1, seen.v1);
  Store(v2, seen.v2);
  seen.h = static_cast<float>(n.dot(s));
  seen.v1_s = static_cast<float>(v1.dot(s));
  seen.v2_s = static_cast<float>(v2.dot(s));
  return seen;
}

// Number of points, of so many rays, that have passed the plane.
LAMINA_FOR_EACH_PROCESSOR
std::int32_t Passed(const SeenPlane& p, const float* x, const float* y, const float* z,
                    const std::int32_t* points, std::size_t count) {
  std::int32_t passed = 0;
  for (std::size_t i = 0; i < count; ++i) {
    const float along = p.n[0] * x[i] + p.n[1] * y[i] + p.n[2] * z[i];
    const float r1 = p.v1[0] * x[i] + p.v1[1] * y[i] + p.v1[2] * z[i];
    const float r2 = p.v2[0] * x[i] + p.v2[1] * y[i] + p.v2[2] * z[i];
    const float c1 = p.v1_s * along - p.h * r1, c2 = p.v2_s * along - p.h * r2;
    const bool behind = p.h + along < -kBehindM;
    const bool inside = c1 * c1 + c2 * c2 < kSigmas2 * along * along;
    passed += behind & inside ? points[i] : 0;
  }
  return passed;
}

}  // namespace

BeamsOfScan::BeamsOfScan(const std::vector<PointCluster>& clusters, const SE3& T_world_lidar)
    : sensor_(T_world_lidar.t) {
  const Eigen::Matrix3d R = T_world_lidar.R();
  for (const PointCluster& cluster : clusters) {
    const Eigen::Vector3f ray = (R * cluster.mean).cast<float>();
    rays_x_.push_back(ray.x());
    rays_y_.push_back(ray.y());
    rays_z_.push_back(ray.z());
    points_.push_back(static_cast<std::int32_t>(cluster.count));
  }
}

bool BeamsOfScan::SeeThrough(const Surface& plane, const PointCluster& members, double hit) const {
  constexpr double kMostPassing = 0.3;
  // Rays that are counted before the sum is compared with the threshold.
  constexpr std::size_t kAtOnce = 256;
  const SeenPlane seen = AsSeen(plane, members, sensor_);
  std::int64_t passed = 0;
  for (std::size_t i = 0; i < points_.size(); i += kAtOnce) {
    passed += Passed(seen, &rays_x_[i], &rays_y_[i], &rays_z_[i], &points_[i],
                     std::min(kAtOnce, points_.size() - i));
    if (static_cast<double>(passed) > kMostPassing * hit) return true;
  }
  return false;
}

SeenThrough MapResiduals::FindSeenThrough(const MetPlanes& met, const Vector6d& direction,
                                          double feigned) const {
  // Margin of the early end: what is within rounding is decided by the sums of all planes.
  constexpr double kSure = 1.001;
  struct Facing {
    VoxelMap::NodeId id;
    const MetPlanes::Plane* plane;
    double information;  // along the direction
    bool through;
  };
  const Vector6d unscaled = DividedByArm(direction);
  std::vector<Facing> facing;
  std::vector<std::size_t> most_first;
  double all = feigned;
  for (const MetPlanes::Plane& plane : met.planes) {
    if (!plane.faces) continue;
    most_first.push_back(facing.size());
    facing.push_back({plane.id, &plane, unscaled.dot(plane.sums.H() * unscaled), false});
    all += facing.back().information;
  }
  std::sort(most_first.begin(), most_first.end(), [&](std::size_t a, std::size_t b) {
    return facing[a].information > facing[b].information;
  });
  double opaque = 0.0;
  for (const std::size_t i : most_first) {
    Facing& f = facing[i];
    f.through = met.beams.SeeThrough(*f.plane->plane, map_.Aggregate(f.id), f.plane->points);
    if (!f.through) opaque += f.information;
    if (2.0 * opaque > kSure * all) return SeenThrough();
  }
  SeenThrough seen;
  for (const Facing& f : facing) {
    (f.through ? seen.H : seen.H_opaque) += f.plane->sums.H();
    if (f.through) seen.planes.push_back(f.id);
  }
  // Rounding differs across the diagonal.
  seen.H = seen.H.selfadjointView<Eigen::Upper>();
  seen.H_opaque = seen.H_opaque.selfadjointView<Eigen::Upper>();
  return seen;
}

bool MapResiduals::OfOneSensor(const MetPlanes& met) const {
  constexpr int kLeastOthers = 20;
  constexpr double kMostPassed = 0.02;
  const auto others = std::count_if(met.planes.begin(), met.planes.end(),
                                    [](const auto& plane) { return !plane.faces; });
  if (others < kLeastOthers) return false;
  int through = 0;
  for (const MetPlanes::Plane& plane : met.planes) {
    if (plane.faces || !met.beams.SeeThrough(*plane.plane, map_.Aggregate(plane.id), plane.points))
      continue;
    if (++through > kMostPassed * static_cast<double>(others)) return false;
  }
  return true;
}

}  // namespace lamina
