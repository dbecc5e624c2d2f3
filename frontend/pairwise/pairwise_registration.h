// Two scans in, the motion between them out: the well-known methods, behind one interface.
//
//   icp_point  point to point (Besl and McKay 1992), PCL                       pcl_registration.h
//   icp_plane  point to plane (Chen and Medioni 1992), PCL                     pcl_registration.h
//   gicp       plane to plane (Segal et al. 2009), PCL                         pcl_registration.h
//   ndt        points to normal distributions (Magnusson 2009), PCL            pcl_registration.h
//   vgicp      voxelised GICP (Koide et al. 2021), on our own clusters         voxelized_gicp.h
//   teaser     TEASER++ (Yang et al. 2020)                                     teaser.h
//   fgr        fast global registration (Zhou et al. 2016)        fast_global_registration.h
//
// The last two need no initial guess: they match FPFH features (Rusu et al. 2009, PCL). What of PCL
// looks for neighbours, but for ndt, does so with nanoflann (pcl_search.h).
// Every method finds T_target_source, p_target = T_target_source * p_source. Metres.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <memory>
#include <string>
#include <vector>

#include "core/geometry/point_cluster.h"
#include "core/geometry/se3.h"
#include "core/options/options.h"
#include "frontend/scan/scan_preparation.h"

namespace lamina {

enum class PairwiseKind { kIcpPoint, kIcpPlane, kGicp, kNdt, kVgicp, kTeaser, kFgr };
// Their names, in the order of the enumeration.
const std::vector<std::string>& PairwiseNames();
// Needs no initial guess.
bool IsGlobal(PairwiseKind kind);

struct PairwiseOptions {
  // Edge of the voxels in which a scan keeps one point, their mean.
  double downsample_m = 0.1;
  // A scan with fewer points after that is refused.
  int min_points = 100;
  // Local methods: steps at most; and converged when a step turns and moves by less.
  int max_iterations = 30;
  double min_rotation_step_deg = 0.01;
  double min_translation_step_m = 0.001;
  // icp_point, icp_plane, gicp: pairs of points farther apart are no pairs.
  double max_distance_m = 1.0;
  // icp_plane, gicp, vgicp: neighbours that make the plane or distribution of a point.
  int neighbours = 15;
  // ndt, vgicp: edge of the voxels that hold a distribution each.
  double ndt_voxel_m = 1.0;
  double vgicp_voxel_m = 0.5;
  // ndt: the moving scan keeps one point for each voxel of this edge. Distributions need dense
  // points, their mean does not, and NDT looks about each of them in every step.
  double ndt_source_voxel_m = 0.2;
  // A match in which fewer points meet the other scan's (within max_distance_m) is refused.
  double min_overlap = 0.1;
  // Global methods: one feature for each voxel of this edge; everything else is in such voxels. 0:
  // as FeatureVoxel finds it.
  double feature_voxel_m = 0.0;
  // Features of a scan at most: those least like the scan's mean feature.
  int max_features = 2500;
  double normal_radius_voxels = 2.5;
  double feature_radius_voxels = 5.0;
  // Noise bound of a matched point.
  double feature_noise_voxels = 0.5;
  // Matches that are kept, those of the most distinct features.
  int max_matches = 400;
  // Matches that must agree, or the registration is refused.
  int min_consistent = 12;

  void Visit(OptionVisitor& v);
};

// A scan, or a map in a scan's place, with what the methods have made of it. Vectors that are not
// empty are as long as `points`.
struct PairwiseCloud {
  std::vector<Eigen::Vector3f> points;
  std::vector<Eigen::Vector3f> normals;  // unit, of either sign
  // Of the neighbourhood, with eigenvalues set to (1, 1, 1e-3) as GICP has it.
  std::vector<Symmetric3> covariances;
  // One for each feature voxel: FPFH of 33 numbers, a column each.
  std::vector<Eigen::Vector3f> feature_points;
  Eigen::Matrix<float, 33, Eigen::Dynamic> features;
};

struct PairwiseResult {
  bool good = false;
  std::string reason;  // of a failure
  SE3 T_target_source;
  int iterations = 0;
  int inliers = 0;  // global methods: matches that agree with the result
};

// Stateless; thread-safe. Deterministic.
class PairwiseMethod {
 public:
  virtual ~PairwiseMethod() = default;
  // Adds to a cloud of points what the method needs.
  virtual void Prepare(PairwiseCloud* cloud) const = 0;
  // Both must have been prepared. `initial` is T_target_source; global methods do not look at it.
  // What cannot be registered is a result that is not good, with its reason.
  virtual PairwiseResult Register(const PairwiseCloud& source, const PairwiseCloud& target,
                                  const SE3& initial) const = 0;
};

// 4 % of the median range of the points, between 0.1 and 0.3 m: rooms want finer features than open
// country.
double FeatureVoxel(const std::vector<std::vector<Eigen::Vector3f>>& scans);

// Throws OptionError. A feature voxel of 0 is taken for 0.25 m.
std::unique_ptr<PairwiseMethod> MakePairwiseMethod(PairwiseKind kind,
                                                   const PairwiseOptions& options);

// The mean of the points in each voxel, in the order in which the voxels were first met.
std::vector<Eigen::Vector3f> Downsample(const std::vector<Eigen::Vector3f>& points, double voxel_m);

// Share of the points that have, at the pose, a point of the target in a voxel that the cube of one
// voxel's size about them reaches into: one within half a voxel for sure, none beyond 2.6.
double OverlapShare(const std::vector<Eigen::Vector3f>& source,
                    const std::vector<Eigen::Vector3f>& target, const SE3& T_target_source,
                    double voxel_m);

}  // namespace lamina
