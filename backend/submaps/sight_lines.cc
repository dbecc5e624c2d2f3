#include "backend/submaps/sight_lines.h"

#include <algorithm>
#include <cmath>

#include "core/base/angle.h"
#include "core/base/thinning.h"

namespace lamina {
namespace {

constexpr int kAzimuths = 144, kElevations = 72;
constexpr double kBin = 2.0 * M_PI / kAzimuths;
// Half the angle that a cluster nearby covers, at most.
constexpr double kMostHalf = Radians(12.0);
// Keyframes that are looked from; how far away.
constexpr std::size_t kMostKeyframes = 5;
constexpr double kLeastRangeM = 1.0, kMostRangeM = 40.0;
// What is farther by so much is behind: metres, and as a share of the range. Of submaps more: they
// are bent by what odometry drifts in them.
constexpr double kBehindM = 0.4, kBehindOfSubmapsM = 1.5, kBehindShare = 0.05;

struct Direction {
  int azimuth = 0, elevation = 0;
};

// In single precision: a bin is 2.5 deg.
Direction BinOf(const Eigen::Vector3d& at) {
  constexpr auto kPi = static_cast<float>(M_PI), kBins = static_cast<float>(1.0 / kBin);
  const Eigen::Vector3f p = at.cast<float>();
  const float azimuth = std::atan2(p.y(), p.x()) + kPi;
  const float elevation = std::atan2(p.z(), std::sqrt(p.x() * p.x() + p.y() * p.y())) + 0.5F * kPi;
  return {static_cast<int>(azimuth * kBins) % kAzimuths,
          std::min(kElevations - 1, static_cast<int>(elevation * kBins))};
}

std::size_t PixelOf(int azimuth, int elevation) {
  return static_cast<std::size_t>(elevation * kAzimuths + (azimuth + kAzimuths) % kAzimuths);
}

}  // namespace

SightLines::SightLines(const std::vector<FinalKeyframe>& keyframes, double leaf_size_m)
    : leaf_size_m_(leaf_size_m), behind_m_(std::max(kBehindM, leaf_size_m)) {
  const std::size_t stride = StrideToAtMost(keyframes.size(), kMostKeyframes);
  for (std::size_t i = 0; i < keyframes.size(); i += stride) {
    std::vector<Eigen::Vector3d> means;
    for (const PointCluster& cluster : keyframes[i].clusters) means.push_back(cluster.mean);
    images_.push_back(ImageOf(keyframes[i].T_world_lidar, means));
  }
}

SightLines::SightLines(const Submap& submap, const SubmapLeaves& leaves)
    : leaf_size_m_(submap.leaf_size_m), behind_m_(std::max(kBehindOfSubmapsM, submap.leaf_size_m)) {
  std::vector<Eigen::Vector3d> means;
  means.reserve(leaves.size());
  for (const SubmapLeaf& leaf : leaves) means.push_back(submap.Cluster(leaf).mean);
  const std::size_t stride = StrideToAtMost(submap.keyframes.size(), kMostKeyframes);
  for (std::size_t i = 0; i < submap.keyframes.size(); i += stride)
    images_.push_back(ImageOf(submap.keyframes[i].T_submap_lidar, means));
}

SightLines::Image SightLines::ImageOf(const SE3& T_own_lidar,
                                      const std::vector<Eigen::Vector3d>& means) const {
  Image image{T_own_lidar.Inverse(),
              std::vector<float>(static_cast<std::size_t>(kAzimuths * kElevations),
                                 std::numeric_limits<float>::infinity())};
  const Eigen::Matrix3d R = image.T_lidar_own.R();
  for (const Eigen::Vector3d& mean : means) Splat(R * mean + image.T_lidar_own.t, &image);
  return image;
}

void SightLines::Splat(const Eigen::Vector3d& p_lidar, Image* image) const {
  const double range = p_lidar.norm();
  if (range < 1e-3) return;
  const Direction at = BinOf(p_lidar);
  const double half = std::min(kMostHalf, 0.5 * leaf_size_m_ / range);
  const int up = static_cast<int>(half / kBin);
  const double level = std::max(0.1, std::hypot(p_lidar.x(), p_lidar.y()) / range);
  const int along = static_cast<int>(std::min(kMostHalf, half / level) / kBin);
  for (int e = std::max(0, at.elevation - up); e <= std::min(kElevations - 1, at.elevation + up);
       ++e) {
    for (int a = at.azimuth - along; a <= at.azimuth + along; ++a) {
      float& nearest = image->nearest_m[PixelOf(a, e)];
      nearest = std::min(nearest, static_cast<float>(range));
    }
  }
}

// Of what was seen in that direction and beside it; infinity where nothing was seen in it.
float SightLines::Nearest(const Image& image, const Eigen::Vector3d& p_lidar) const {
  const Direction at = BinOf(p_lidar);
  float nearest = image.nearest_m[PixelOf(at.azimuth, at.elevation)];
  if (std::isinf(nearest)) return nearest;
  for (int e = std::max(0, at.elevation - 1); e <= std::min(kElevations - 1, at.elevation + 1);
       ++e) {
    for (int a = at.azimuth - 1; a <= at.azimuth + 1; ++a)
      nearest = std::min(nearest, image.nearest_m[PixelOf(a, e)]);
  }
  return nearest;
}

SightLines::Seen SightLines::LookFrom(const Image& image,
                                      const std::vector<Eigen::Vector3f>& points,
                                      const SE3& T_own_points, const Eigen::Vector3d& up_own,
                                      double least_m) const {
  const SE3 T = image.T_lidar_own * T_own_points;
  const Eigen::Matrix3d R = T.R();
  const Eigen::Vector3d up = image.T_lidar_own.q * up_own;
  Seen seen;
  for (const Eigen::Vector3f& point : points) {
    const Eigen::Vector3d p = R * point.cast<double>() + T.t;
    const double range = p.norm();
    if (range < kLeastRangeM || range > kMostRangeM || up.dot(p) < least_m) continue;
    const auto nearest = static_cast<double>(Nearest(image, p));
    if (std::isinf(nearest)) continue;
    const double behind = behind_m_ + kBehindShare * range;
    if (nearest > range + behind) {
      ++seen.gone;
    } else if (nearest > range - behind) {
      ++seen.there;
    }
  }
  return seen;
}

SightLines::Seen SightLines::Look(const std::vector<Eigen::Vector3f>& points,
                                  const SE3& T_own_points) const {
  return LookAbove(points, T_own_points, Eigen::Vector3d::UnitZ(),
                   -std::numeric_limits<double>::infinity());
}

SightLines::Seen SightLines::LookAbove(const std::vector<Eigen::Vector3f>& points,
                                       const SE3& T_own_points, const Eigen::Vector3d& up_own,
                                       double least_m) const {
  Seen seen;
  for (const Image& image : images_)
    seen = seen + LookFrom(image, points, T_own_points, up_own, least_m);
  return seen;
}

}  // namespace lamina
