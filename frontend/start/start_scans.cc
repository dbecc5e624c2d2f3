#include "frontend/start/start_scans.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cstdint>

#include "frontend/scan/scan_clusters.h"

namespace lamina {

std::vector<SE3> StartScans::OwnPoses() const {
  std::vector<SE3> own;
  for (const StartScan& scan : scans_) own.push_back(scan.T_world_lidar);
  return own;
}

double StartScans::GapS(std::size_t scan) const {
  return SecondsBetween(scans_[scan - 1].stamp_ns, scans_[scan].stamp_ns);
}

double StartScans::LengthS() const {
  return SecondsBetween(scans_.front().stamp_ns, scans_.back().stamp_ns);
}

Vector6d StartScans::Twist(const std::vector<SE3>& poses, std::size_t scan) const {
  const std::size_t after = std::max<std::size_t>(scan, 1);
  if (after >= poses.size()) return Vector6d::Zero();
  return MeanTwist(poses[after - 1], poses[after], GapS(after));
}

SweepMotion StartScans::Sweep(const std::vector<SE3>& poses, std::size_t scan) const {
  SweepMotion sweep = scans_[scan].sweep;
  sweep.twist += Twist(poses, scan);
  return sweep;
}

std::vector<PointCluster> StartScans::Deskewed(std::size_t scan,
                                               const std::vector<SE3>& poses) const {
  return DeskewClusters(scans_[scan].clusters, Sweep(poses, scan));
}

VoxelMap StartScans::MapOf(const std::vector<SE3>& poses, std::size_t scans,
                           std::size_t without) const {
  VoxelMap map(map_options_);
  for (std::size_t k = 0; k < scans; ++k) {
    if (k != without) map.AddFrame(Deskewed(k, poses), poses[k], static_cast<std::int64_t>(k));
  }
  map.Refresh();
  return map;
}

Eigen::Matrix3d StartScans::Faced(const std::vector<SE3>& poses, std::size_t scans) const {
  const VoxelMap map = MapOf(poses, scans);
  Eigen::Matrix3d faced = Eigen::Matrix3d::Zero();
  const std::size_t last = scans_.size() - 1;
  for (const PointCluster& cluster : Deskewed(last, poses)) {
    const Surface* plane = map.PlaneAt(poses[last] * cluster.mean);
    if (plane == nullptr) continue;
    const Eigen::Vector3d normal = plane->normal.cast<double>();
    faced += normal * normal.transpose();
  }
  return faced;
}

Eigen::Vector3d LeastFaced(const Eigen::Matrix3d& faced) {
  return Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(faced).eigenvectors().col(0);
}

double Apart(const std::vector<SE3>& a, const std::vector<SE3>& b) {
  double apart_m = 0.0;
  for (std::size_t k = 0; k < a.size(); ++k) apart_m = std::max(apart_m, (a[k].t - b[k].t).norm());
  return apart_m;
}

bool Stands(const std::vector<SE3>& way) {
  constexpr double kStandsM = 0.3;
  return Apart(way, std::vector<SE3>(way.size(), way.front())) < kStandsM;
}

}  // namespace lamina
