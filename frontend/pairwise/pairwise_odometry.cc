#include "frontend/pairwise/pairwise_odometry.h"

#include <algorithm>
#include <cmath>

namespace lamina {
namespace {

std::string Named(std::size_t scan, const std::string& against, const std::string& reason) {
  return "scan " + std::to_string(scan) + " against " + against + ": " + reason;
}

// Reason why a match is not to be believed; empty if it is.
std::string Fault(const PairwiseResult& result, const PairwiseCloud& source,
                  const PairwiseCloud& target, const PairwiseOptions& options) {
  if (!result.good) return result.reason;
  const double share = OverlapShare(source.points, target.points, result.T_target_source,
                                    0.5 * options.max_distance_m);
  if (share >= options.min_overlap) return "";
  return std::to_string(static_cast<int>(100.0 * share)) + " % of its points meet the other's, " +
         std::to_string(static_cast<int>(100.0 * options.min_overlap)) + " % at least must";
}

double Reach(const PairwiseCloud& cloud) {
  float reach2 = 0.0F;
  for (const Eigen::Vector3f& p : cloud.points) reach2 = std::max(reach2, p.squaredNorm());
  return std::sqrt(static_cast<double>(reach2));
}

}  // namespace

std::vector<PairwiseCloud> PrepareClouds(const PairwiseMethod& method,
                                         const PairwiseOptions& options,
                                         const std::vector<std::vector<Eigen::Vector3f>>& scans,
                                         std::string* fault) {
  std::vector<PairwiseCloud> clouds(scans.size());
  for (std::size_t k = 0; k < scans.size(); ++k) {
    clouds[k].points = Downsample(scans[k], options.downsample_m);
    if (clouds[k].points.size() < static_cast<std::size_t>(options.min_points)) {
      *fault = "scan " + std::to_string(k) + ": " + std::to_string(clouds[k].points.size()) +
               " points are left, at least " + std::to_string(options.min_points) + " are wanted";
      return {};
    }
    method.Prepare(&clouds[k]);
  }
  return clouds;
}

PairwiseSequenceResult FrameToFrame(const PairwiseMethod& method, const PairwiseOptions& options,
                                    const std::vector<PairwiseCloud>& clouds,
                                    const std::vector<SE3>& initial,
                                    const PairwiseProgress& progress) {
  PairwiseSequenceResult result;
  result.poses.emplace_back();
  progress();
  for (std::size_t k = 1; k < clouds.size(); ++k) {
    const SE3 guess = initial.empty() ? SE3() : initial[k - 1].Inverse() * initial[k];
    const PairwiseResult match = method.Register(clouds[k], clouds[k - 1], guess);
    const std::string fault = Fault(match, clouds[k], clouds[k - 1], options);
    if (!fault.empty()) {
      result.reason = Named(k, "scan " + std::to_string(k - 1), fault);
      return result;
    }
    result.poses.push_back(result.poses.back() * match.T_target_source);
    progress();
  }
  result.good = true;
  return result;
}

PairwiseSequenceResult FrameToMap(const PairwiseMethod& method, const PairwiseOptions& options,
                                  const std::vector<PairwiseCloud>& clouds,
                                  const PairwiseSequenceResult& frame_to_frame,
                                  const PairwiseProgress& progress) {
  PairwiseSequenceResult result;
  if (!frame_to_frame.good) {
    result.reason = frame_to_frame.reason;
    return result;
  }
  const std::vector<SE3>& chained = frame_to_frame.poses;
  PairwiseMap map(options.downsample_m);
  for (std::size_t k = 0; k < clouds.size(); ++k) {
    SE3 pose;
    if (k > 0) {
      const SE3 guess = result.poses.back() * (chained[k - 1].Inverse() * chained[k]);
      // As far again as matching may move the scan.
      const PairwiseCloud around =
          map.Around(guess.t, Reach(clouds[k]) + 2.0 * options.max_distance_m);
      const PairwiseResult match = method.Register(clouds[k], around, guess);
      const std::string fault = Fault(match, clouds[k], around, options);
      if (!fault.empty()) {
        result.reason = Named(k, "the map", fault);
        return result;
      }
      pose = match.T_target_source;
    }
    result.poses.push_back(pose);
    map.Add(clouds[k], pose);
    progress();
  }
  result.good = true;
  return result;
}

void PairwiseMap::Add(const PairwiseCloud& cloud, const SE3& T_world_cloud) {
  const Eigen::Matrix3d R = T_world_cloud.R();
  for (std::size_t i = 0; i < cloud.points.size(); ++i) {
    const Eigen::Vector3d p = R * cloud.points[i].cast<double>() + T_world_cloud.t;
    if (!IsVoxelKeyInRange(p, inverse_voxel_)) continue;
    if (!taken_.Insert(VoxelKeyOf(p, inverse_voxel_))) continue;
    all_.points.push_back(p.cast<float>());
    if (!cloud.normals.empty()) all_.normals.push_back(R.cast<float>() * cloud.normals[i]);
    if (!cloud.covariances.empty()) all_.covariances.push_back(cloud.covariances[i].Rotated(R));
  }
}

PairwiseCloud PairwiseMap::Around(const Eigen::Vector3d& place, double radius_m) const {
  const Eigen::Vector3f centre = place.cast<float>();
  const auto radius2 = static_cast<float>(radius_m * radius_m);
  PairwiseCloud near;
  for (std::size_t i = 0; i < all_.points.size(); ++i) {
    if ((all_.points[i] - centre).squaredNorm() > radius2) continue;
    near.points.push_back(all_.points[i]);
    if (!all_.normals.empty()) near.normals.push_back(all_.normals[i]);
    if (!all_.covariances.empty()) near.covariances.push_back(all_.covariances[i]);
  }
  return near;
}

}  // namespace lamina
