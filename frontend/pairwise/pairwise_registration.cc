#include "frontend/pairwise/pairwise_registration.h"

#include <algorithm>

#include "core/base/median.h"
#include "core/map/voxel_key.h"
#include "frontend/pairwise/fast_global_registration.h"
#include "frontend/pairwise/pcl_registration.h"
#include "frontend/pairwise/teaser.h"
#include "frontend/pairwise/voxelized_gicp.h"

namespace lamina {

const std::vector<std::string>& PairwiseNames() {
  static const std::vector<std::string> names = {"icp_point", "icp_plane", "gicp", "ndt",
                                                 "vgicp",     "teaser",    "fgr"};
  return names;
}

bool IsGlobal(PairwiseKind kind) {
  return kind == PairwiseKind::kTeaser || kind == PairwiseKind::kFgr;
}

void PairwiseOptions::Visit(OptionVisitor& v) {
  v.Number("downsample_m", &downsample_m, 0.001, 10.0);
  v.Integer("min_points", &min_points, 10, 1000000);
  v.Integer("max_iterations", &max_iterations, 1, 10000);
  v.Number("min_rotation_step_deg", &min_rotation_step_deg, 0.0, 180.0);
  v.Number("min_translation_step_m", &min_translation_step_m, 0.0, 100.0);
  v.Number("max_distance_m", &max_distance_m, 0.01, 100.0);
  v.Integer("neighbours", &neighbours, 4, 1000);
  v.Number("ndt_voxel_m", &ndt_voxel_m, 0.05, 100.0);
  v.Number("ndt_source_voxel_m", &ndt_source_voxel_m, 0.001, 10.0);
  v.Number("vgicp_voxel_m", &vgicp_voxel_m, 0.05, 100.0);
  v.Number("min_overlap", &min_overlap, 0.0, 1.0);
  v.Number("feature_voxel_m", &feature_voxel_m, 0.0, 10.0);
  v.Integer("max_features", &max_features, 10, 1000000);
  v.Number("normal_radius_voxels", &normal_radius_voxels, 1.0, 20.0);
  v.Number("feature_radius_voxels", &feature_radius_voxels, 1.0, 50.0);
  v.Number("feature_noise_voxels", &feature_noise_voxels, 0.01, 10.0);
  v.Integer("max_matches", &max_matches, 10, 5000);
  v.Integer("min_consistent", &min_consistent, 3, 5000);
}

double FeatureVoxel(const std::vector<std::vector<Eigen::Vector3f>>& scans) {
  std::vector<float> ranges;
  constexpr std::size_t kStride = 17;  // a sample is enough
  for (const auto& scan : scans) {
    for (std::size_t i = 0; i < scan.size(); i += kStride) ranges.push_back(scan[i].norm());
  }
  if (ranges.empty()) return 0.25;
  return std::clamp(0.04 * static_cast<double>(UpperMedian(&ranges)), 0.1, 0.3);
}

std::unique_ptr<PairwiseMethod> MakePairwiseMethod(PairwiseKind kind,
                                                   const PairwiseOptions& given) {
  PairwiseOptions options = given;
  CheckOptions(options, "pairwise");
  if (options.feature_voxel_m == 0.0) options.feature_voxel_m = 0.25;
  switch (kind) {
    case PairwiseKind::kVgicp:
      return MakeVoxelizedGicp(options);
    case PairwiseKind::kTeaser:
      return MakeTeaser(options);
    case PairwiseKind::kFgr:
      return MakeFastGlobalRegistration(options);
    default:
      return MakePclRegistration(kind, options);
  }
}

std::vector<Eigen::Vector3f> Downsample(const std::vector<Eigen::Vector3f>& points,
                                        double voxel_m) {
  struct Sum {
    Eigen::Vector3d offset = Eigen::Vector3d::Zero();  // from the voxel's first point
    Eigen::Vector3f first = Eigen::Vector3f::Zero();
    double count = 0.0;
  };
  VoxelIndex index(points.size() / 4);
  std::vector<Sum> sums;
  for (const Eigen::Vector3f& p : points) {
    const Eigen::Vector3d here = p.cast<double>();
    if (!IsVoxelKeyInRange(here, 1.0 / voxel_m)) continue;
    Sum& sum = index.Gather(VoxelKeyOf(here, 1.0 / voxel_m), &sums);
    if (sum.count == 0.0) sum.first = p;
    sum.offset += (p - sum.first).cast<double>();
    sum.count += 1.0;
  }
  std::vector<Eigen::Vector3f> means;
  means.reserve(sums.size());
  for (const Sum& s : sums) means.push_back(s.first + (s.offset / s.count).cast<float>());
  return means;
}

double OverlapShare(const std::vector<Eigen::Vector3f>& source,
                    const std::vector<Eigen::Vector3f>& target, const SE3& T_target_source,
                    double voxel_m) {
  if (source.empty()) return 0.0;
  const double inverse = 1.0 / voxel_m;
  VoxelIndex occupied(target.size() / 4);
  for (const Eigen::Vector3f& point : target) {
    const Eigen::Vector3d p = point.cast<double>();
    if (IsVoxelKeyInRange(p, inverse)) occupied.Insert(VoxelKeyOf(p, inverse));
  }
  // The eight voxels that a cube of one voxel's size about the point reaches into.
  const auto meets = [&](const Eigen::Vector3d& p) {
    for (int i = 0; i < 8; ++i) {
      const Eigen::Vector3d corner((i & 1) - 0.5, (i >> 1 & 1) - 0.5, (i >> 2 & 1) - 0.5);
      const Eigen::Vector3d q = p + voxel_m * corner;
      if (IsVoxelKeyInRange(q, inverse) &&
          occupied.Find(VoxelKeyOf(q, inverse)) != VoxelIndex::kNone) {
        return true;
      }
    }
    return false;
  };
  std::size_t met = 0;
  for (const Eigen::Vector3f& p : source) met += meets(T_target_source * p.cast<double>()) ? 1 : 0;
  return static_cast<double>(met) / static_cast<double>(source.size());
}

}  // namespace lamina
