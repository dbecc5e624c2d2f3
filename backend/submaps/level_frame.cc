#include "backend/submaps/level_frame.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "core/base/angle.h"
#include "core/base/thinning.h"

namespace lamina {
namespace {

constexpr double kToleranceDeg = 8.0;

// Every n-th, so that at most `most` are left.
std::vector<Eigen::Vector3f> SomeNormals(const std::vector<LeafPlane>& planes, std::size_t most) {
  const std::size_t stride = StrideToAtMost(planes.size(), most);
  std::vector<Eigen::Vector3f> normals;
  for (std::size_t i = 0; i < planes.size(); i += stride) normals.push_back(planes[i].normal);
  return normals;
}

// The principal direction of the normals along `up`.
Eigen::Vector3f MeanAlong(const std::vector<LeafPlane>& planes, const Eigen::Vector3f& up) {
  const auto along = static_cast<float>(std::cos(Radians(kToleranceDeg)));
  Eigen::Matrix3f sum = Eigen::Matrix3f::Zero();
  for (const LeafPlane& plane : planes) {
    if (std::abs(plane.normal.dot(up)) > along) sum += plane.normal * plane.normal.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3f> eigen(sum);
  const Eigen::Vector3f mean = eigen.eigenvectors().col(2);
  return mean.dot(up) < 0.0F ? Eigen::Vector3f(-mean) : mean;
}

}  // namespace

std::vector<LeafPlane> LeafPlanes(const Submap& submap) {
  constexpr float kMinCount = 6.0F;
  constexpr double kMaxFlatness = 0.1, kMinBreadth = 0.05, kMaxThicknessM = 0.1;
  std::vector<LeafPlane> planes;
  const SubmapLeaves leaves = submap.Leaves();
  for (std::size_t i = 0; i < leaves.size(); ++i) {
    const SubmapLeaf& leaf = leaves[i];
    if (leaf.cluster.count < kMinCount) continue;
    const PointCluster cluster = submap.Cluster(leaf);
    const Eigen3 eigen = cluster.EigenPairs();
    if (eigen.l(2) > kMaxFlatness * eigen.l(1) || eigen.l(1) < kMinBreadth * eigen.l(0) ||
        eigen.l(2) > kMaxThicknessM * kMaxThicknessM)
      continue;
    planes.push_back({cluster.mean.cast<float>(), eigen.u.col(2).cast<float>(),
                      static_cast<float>(std::max(0.0, eigen.l(2))), i});
  }
  return planes;
}

std::vector<Eigen::Vector3f> UprightLeaves(const Submap& submap,
                                           const std::vector<LeafPlane>& planes,
                                           const Eigen::Vector3d& up) {
  std::vector<Eigen::Vector3f> means;
  auto plane = planes.begin();
  const SubmapLeaves leaves = submap.Leaves();
  for (std::size_t i = 0; i < leaves.size(); ++i) {
    const bool planar = plane != planes.end() && plane->leaf == i;
    if (!planar || !LiesFlat(*plane, up))
      means.push_back(submap.Cluster(leaves[i]).mean.cast<float>());
    if (planar) ++plane;
  }
  return means;
}

Eigen::Vector3d UpOfPlanes(const std::vector<LeafPlane>& planes, const Eigen::Vector3d& expected,
                           double within_deg) {
  const auto along = static_cast<float>(std::cos(Radians(kToleranceDeg)));
  const auto across = static_cast<float>(std::sin(Radians(kToleranceDeg)));
  const auto near = static_cast<float>(std::cos(Radians(within_deg)));
  const Eigen::Vector3f prior = expected.cast<float>();
  const std::vector<Eigen::Vector3f> normals = SomeNormals(planes, 1500);
  Eigen::Vector3f best = prior;
  float best_score = -1.0F;
  for (const Eigen::Vector3f& normal : SomeNormals(planes, 400)) {
    const float cosine = normal.dot(prior);
    if (std::abs(cosine) < near) continue;
    float score = 0.0F;
    for (const Eigen::Vector3f& m : normals) {
      const float c = std::abs(m.dot(normal));
      score += c > along ? 1.0F : c < across ? 0.5F : 0.0F;
    }
    if (score <= best_score) continue;
    best_score = score;
    best = cosine < 0.0F ? Eigen::Vector3f(-normal) : normal;
  }
  if (best_score < 0.0F) return expected;
  return MeanAlong(planes, MeanAlong(planes, best)).cast<double>().normalized();
}

}  // namespace lamina
