#include "backend/localisation/place_evidence.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

#include "core/base/angle.h"

namespace lamina {
namespace {

constexpr int kAzimuths = SightLines::kAzimuths, kElevations = SightLines::kElevations;
constexpr double kBin = 2.0 * M_PI / kAzimuths;
// Half the angle that a cluster nearby covers, at most.
constexpr double kMostHalf = Radians(12.0);
// Keyframes that are looked from; points that are asked for; how far away.
constexpr std::size_t kMostKeyframes = 5, kMostPoints = 4000;
constexpr double kLeastRangeM = 1.0, kMostRangeM = 40.0;
// What is farther by so much is behind: metres, and as a share of the range.
constexpr double kBehindM = 0.4, kBehindShare = 0.05;

struct Direction {
  int azimuth = 0, elevation = 0;
};

Direction BinOf(const Eigen::Vector3d& p) {
  const double azimuth = std::atan2(p.y(), p.x()) + M_PI;
  const double elevation = std::atan2(p.z(), std::hypot(p.x(), p.y())) + 0.5 * M_PI;
  return {static_cast<int>(azimuth / kBin) % kAzimuths,
          std::min(kElevations - 1, static_cast<int>(elevation / kBin))};
}

std::size_t PixelOf(int azimuth, int elevation) {
  return static_cast<std::size_t>(elevation * kAzimuths + (azimuth + kAzimuths) % kAzimuths);
}

}  // namespace

OccupiedLeaves::OccupiedLeaves(const Submap& place)
    : leaf_size_m_(place.leaf_size_m), index_(place.leaves.size()) {
  for (const SubmapLeaf& leaf : place.leaves)
    index_.Insert(PackVoxelKey(leaf.index[0], leaf.index[1], leaf.index[2]));
}

double OccupiedLeaves::Met(const std::vector<Eigen::Vector3f>& points,
                           const SE3& T_place_query) const {
  const std::size_t stride = std::max<std::size_t>(1, points.size() / kMostPoints);
  const double inverse = 1.0 / leaf_size_m_;
  std::size_t asked = 0, met = 0;
  for (std::size_t i = 0; i < points.size(); i += stride) {
    const Eigen::Vector3d p = T_place_query * points[i].cast<double>();
    ++asked;
    bool any = false;
    for (int corner = 0; corner < 8 && !any; ++corner) {
      const Eigen::Vector3d half(corner & 1, (corner >> 1) & 1, corner >> 2);
      const Eigen::Vector3d at = p + leaf_size_m_ * (half.array() - 0.5).matrix();
      any = IsVoxelKeyInRange(at, inverse) &&
            index_.Find(VoxelKeyOf(at, inverse)) != VoxelIndex::kNone;
    }
    met += any ? 1 : 0;
  }
  return asked == 0 ? 0.0 : static_cast<double>(met) / static_cast<double>(asked);
}

SightLines::SightLines(const std::vector<FinalKeyframe>& keyframes, double leaf_size_m)
    : leaf_size_m_(leaf_size_m) {
  const std::size_t stride =
      std::max<std::size_t>(1, (keyframes.size() + kMostKeyframes - 1) / kMostKeyframes);
  for (std::size_t i = 0; i < keyframes.size(); i += stride) {
    Image image;
    image.T_lidar_own = keyframes[i].T_world_lidar.Inverse();
    image.nearest_m.assign(static_cast<std::size_t>(kAzimuths * kElevations),
                           std::numeric_limits<float>::infinity());
    for (const PointCluster& cluster : keyframes[i].clusters)
      Splat(image.T_lidar_own * cluster.mean, &image);
    images_.push_back(std::move(image));
  }
}

void SightLines::Splat(const Eigen::Vector3d& p, Image* image) const {
  const double range = p.norm();
  if (range < 1e-3) return;
  const Direction at = BinOf(p);
  const double half = std::min(kMostHalf, 0.5 * leaf_size_m_ / range);
  const int up = static_cast<int>(half / kBin);
  const double level = std::max(0.1, std::hypot(p.x(), p.y()) / range);
  const int along = static_cast<int>(std::min(kMostHalf, half / level) / kBin);
  for (int e = std::max(0, at.elevation - up); e <= std::min(kElevations - 1, at.elevation + up);
       ++e) {
    for (int a = at.azimuth - along; a <= at.azimuth + along; ++a) {
      float& nearest = image->nearest_m[PixelOf(a, e)];
      nearest = std::min(nearest, static_cast<float>(range));
    }
  }
}

SightLines::Seen SightLines::Look(const std::vector<Eigen::Vector3f>& points,
                                  const SE3& T_own_points) const {
  Seen seen;
  for (const Image& image : images_) {
    const SE3 T = image.T_lidar_own * T_own_points;
    for (const Eigen::Vector3f& point : points) {
      const Eigen::Vector3d p = T * point.cast<double>();
      const double range = p.norm();
      if (range < kLeastRangeM || range > kMostRangeM) continue;
      const Direction at = BinOf(p);
      if (std::isinf(image.nearest_m[PixelOf(at.azimuth, at.elevation)])) continue;
      float nearest = std::numeric_limits<float>::infinity();
      for (int e = std::max(0, at.elevation - 1); e <= std::min(kElevations - 1, at.elevation + 1);
           ++e) {
        for (int a = at.azimuth - 1; a <= at.azimuth + 1; ++a)
          nearest = std::min(nearest, image.nearest_m[PixelOf(a, e)]);
      }
      const double behind = std::max(kBehindM, leaf_size_m_) + kBehindShare * range;
      if (static_cast<double>(nearest) > range + behind) {
        ++seen.gone;
      } else if (static_cast<double>(nearest) > range - behind) {
        ++seen.there;
      }
    }
  }
  return seen;
}

}  // namespace lamina
