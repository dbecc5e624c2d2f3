// Neighbourhoods and features.
#include <pcl/features/fpfh.h>
#include <pcl/point_types.h>

#include <algorithm>
#include <utility>

#include "core/base/parallel.h"
#include "frontend/pairwise/pcl_registration.h"
#include "frontend/pairwise/pcl_search.h"

namespace lamina {
namespace {

using Cloud = pcl::PointCloud<pcl::PointXYZ>;
using Tree = PclSearch<pcl::PointXYZ>;

Cloud::Ptr ToPcl(const std::vector<Eigen::Vector3f>& points) {
  auto out = pcl::make_shared<Cloud>();
  for (const Eigen::Vector3f& p : points) out->emplace_back(p.x(), p.y(), p.z());
  return out;
}

PointCluster ClusterOf(const std::vector<Eigen::Vector3f>& points, const pcl::Indices& indices) {
  PointCluster cluster;
  for (const pcl::index_t i : indices) {
    cluster.AddPoint(points[static_cast<std::size_t>(i)].cast<double>());
  }
  return cluster;
}

using Histogram = Eigen::Matrix<float, 33, 1>;

Histogram HistogramOf(const pcl::FPFHSignature33& signature) {
  return Eigen::Map<const Histogram>(signature.histogram);
}

// Indices, ascending, of the signatures farthest from the mean: what is everywhere (walls, lawn)
// tells places apart least (Rusu et al. 2009).
std::vector<std::size_t> MostDistinct(const pcl::PointCloud<pcl::FPFHSignature33>& signatures,
                                      std::size_t most) {
  Histogram mean = Histogram::Zero();
  for (const auto& s : signatures) mean += HistogramOf(s) / static_cast<float>(signatures.size());
  std::vector<std::pair<float, std::size_t>> order;
  for (std::size_t i = 0; i < signatures.size(); ++i) {
    order.emplace_back(-(HistogramOf(signatures[i]) - mean).squaredNorm(), i);
  }
  std::sort(order.begin(), order.end());
  if (order.size() > most) order.resize(most);
  std::vector<std::size_t> indices;
  for (const auto& [distance, i] : order) indices.push_back(i);
  std::sort(indices.begin(), indices.end());
  return indices;
}

}  // namespace

void AddNeighbourhoods(int neighbours, PairwiseCloud* cloud) {
  Tree tree(false);
  tree.setInputCloud(ToPcl(cloud->points));
  const std::size_t n = cloud->points.size();
  cloud->normals.resize(n);
  cloud->covariances.resize(n);
  ParallelChunks(n, 1024, [&](std::size_t begin, std::size_t end) {
    pcl::Indices indices;
    std::vector<float> distances;
    for (std::size_t i = begin; i < end; ++i) {
      const Eigen::Vector3f& p = cloud->points[i];
      tree.nearestKSearch(pcl::PointXYZ(p.x(), p.y(), p.z()), neighbours, indices, distances);
      const Eigen3 eigen = ClusterOf(cloud->points, indices).EigenPairs();
      const Eigen::Vector3d normal = eigen.u.col(2);
      cloud->normals[i] = normal.cast<float>();
      // u diag(1, 1, 1e-3) u'.
      cloud->covariances[i] = {1.0, 0.0, 0.0, 1.0, 0.0, 1.0};
      cloud->covariances[i].AddOuter(1e-3 - 1.0, normal);
    }
  });
}

double AddFeatures(const PairwiseOptions& options, PairwiseCloud* cloud) {
  const double voxel = options.feature_voxel_m;
  const std::vector<Eigen::Vector3f> all = Downsample(cloud->points, voxel);
  const auto points = ToPcl(all);
  const auto normals = pcl::make_shared<pcl::PointCloud<pcl::Normal>>();
  const auto kept = pcl::make_shared<pcl::Indices>();
  const auto tree = pcl::make_shared<Tree>();
  tree->setInputCloud(points);
  pcl::Indices indices;
  std::vector<float> distances;
  Symmetric3 facing;
  constexpr std::size_t kFewest = 5;
  for (std::size_t i = 0; i < all.size(); ++i) {
    tree->radiusSearch(static_cast<int>(i), options.normal_radius_voxels * voxel, indices,
                       distances);
    Eigen::Vector3d n = ClusterOf(all, indices).EigenPairs().u.col(2);
    if (n.dot(all[i].cast<double>()) > 0.0) n = -n;
    normals->push_back(pcl::Normal(static_cast<float>(n.x()), static_cast<float>(n.y()),
                                   static_cast<float>(n.z())));
    if (indices.size() < kFewest) continue;
    kept->push_back(static_cast<int>(i));
    facing.AddOuter(1.0, n);
  }
  cloud->feature_points.clear();
  cloud->features.resize(33, 0);
  if (kept->empty()) return 0.0;
  pcl::FPFHEstimation<pcl::PointXYZ, pcl::Normal, pcl::FPFHSignature33> estimation;
  estimation.setInputCloud(points);
  estimation.setInputNormals(normals);
  estimation.setIndices(kept);
  estimation.setSearchMethod(tree);
  estimation.setRadiusSearch(options.feature_radius_voxels * voxel);
  pcl::PointCloud<pcl::FPFHSignature33> signatures;
  estimation.compute(signatures);
  const std::vector<std::size_t> distinct =
      MostDistinct(signatures, static_cast<std::size_t>(options.max_features));
  cloud->features.resize(33, static_cast<Eigen::Index>(distinct.size()));
  for (std::size_t k = 0; k < distinct.size(); ++k) {
    cloud->feature_points.push_back(all[static_cast<std::size_t>((*kept)[distinct[k]])]);
    cloud->features.col(static_cast<Eigen::Index>(k)) = HistogramOf(signatures[distinct[k]]);
  }
  return EigenDecompose(facing * (1.0 / static_cast<double>(kept->size()))).l(2);
}

}  // namespace lamina
