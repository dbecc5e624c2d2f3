#include "frontend/start/steady_motion.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <numeric>
#include <utility>

#include "core/base/median.h"
#include "core/base/parallel.h"
#include "core/map/voxel_key.h"
#include "frontend/matching/block_votes.h"
#include "frontend/start/steady_motion_grid.h"

namespace lamina {
namespace {

constexpr double kBlockM = 4.0;
// Points with which a block counts half.
constexpr double kHalfPoints = 20.0;
// Fewer points are no voxel.
constexpr double kLeastPoints = 5.0;

// Of four grids, in voxels: no two of them share a face.
constexpr double kShifts[][3] = {
    {0.1, 0.2, 0.3}, {0.6, 0.7, 0.8}, {0.35, 0.95, 0.05}, {0.85, 0.45, 0.55}};
constexpr std::size_t kGrids = std::size(kShifts);
// As many do where speeds are far apart.
constexpr std::size_t kCoarseGrids = 2;

// Smallest eigenvalue of the covariance; in closed form, as what counts is far above its rounding.
double LeastVariance(const PointCluster& cluster) {
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
  solver.computeDirect(cluster.Covariance().Dense(), Eigen::EigenvaluesOnly);
  return std::max(0.0, solver.eigenvalues()(0));
}

// The same in the plane of two orthonormal vectors.
double LeastVariance(const PointCluster& cluster, const Eigen::Vector3d& u,
                     const Eigen::Vector3d& v) {
  const Eigen::Matrix3d covariance = cluster.Covariance().Dense();
  const Eigen::Vector3d along = covariance * u;
  const double uu = u.dot(along), vv = v.dot(covariance * v), uv = v.dot(along);
  return std::max(0.0, 0.5 * (uu + vv) - std::hypot(0.5 * (uu - vv), uv));
}

double Votes(const std::vector<double>& one, const std::vector<double>& other) {
  BlockVotes votes;
  for (std::size_t b = 0; b < one.size(); ++b) votes.Add(one[b] - other[b]);
  return votes.Sigmas();
}

}  // namespace

SteadyMotionSearch::SteadyMotionSearch(const SteadyMotionOptions& options, const Eigen::Vector3d& u,
                                       const Eigen::Vector3d& axis, std::vector<SteadyScan> scans)
    : options_(options), u_(u), across_(axis.cross(u).normalized()), scans_(std::move(scans)) {
  ThinOut();
  ChooseViews(axis);
  VoxelIndex blocks(256);
  for (const SteadyScan& scan : scans_) {
    for (const PointCluster& cluster : scan.clusters) {
      const std::int32_t block = blocks.FindOrInsert(
          VoxelKeyOf(cluster.mean, 1.0 / kBlockM), static_cast<std::int32_t>(block_points_.size()));
      block_of_.push_back(block);
      if (static_cast<std::size_t>(block) == block_points_.size()) block_points_.push_back(0.0);
      block_points_[static_cast<std::size_t>(block)] += cluster.count;
    }
  }
  const double duration_s = scans_.back().time_s - scans_.front().time_s;
  middle_s_ = 0.5 * (scans_.front().time_s + scans_.back().time_s);
  // L has its maximum over speeds by which the last scan is a voxel off.
  constexpr double kStepVoxels = 0.44;
  step_m_s_ = kStepVoxels * options_.voxel_size_m / std::max(duration_s, 1e-3);
  // Scans that are farther apart than they see have nothing in common.
  std::vector<double> ranges_m;
  for (const PointCluster& cluster : scans_.front().clusters)
    ranges_m.push_back((cluster.mean - scans_.front().centre).norm());
  if (!ranges_m.empty())
    most_speed_m_s_ = std::min(options_.most_speed_m_s,
                               2.0 * UpperMedian(&ranges_m) / std::max(duration_s, 1e-3));
}

void SteadyMotionSearch::ThinOut() {
  // So many tell a speed in any scene, and hundreds of speeds are tried.
  constexpr std::size_t kMostClusters = 3000;
  for (SteadyScan& scan : scans_) {
    const std::size_t stride = (scan.clusters.size() + kMostClusters - 1) / kMostClusters;
    if (stride <= 1) continue;
    std::size_t kept = 0;
    for (std::size_t i = 0; i < scan.clusters.size(); i += stride, ++kept) {
      scan.clusters[kept] = scan.clusters[i];
      if (!scan.cluster_times_s.empty()) scan.cluster_times_s[kept] = scan.cluster_times_s[i];
    }
    scan.clusters.resize(kept);
    if (!scan.cluster_times_s.empty()) scan.cluster_times_s.resize(kept);
  }
}

void SteadyMotionSearch::ChooseViews(const Eigen::Vector3d& axis) {
  constexpr double kColumnM = 4.0, kGroundM = 0.3, kAlongAxis = 0.7;
  VoxelIndex columns(256);
  std::vector<double> lowest_m, heights_m;
  std::vector<std::int32_t> column_of;
  for (const SteadyScan& scan : scans_) {
    for (const PointCluster& cluster : scan.clusters) {
      heights_m.push_back(axis.dot(cluster.mean));
      const Eigen::Vector3d foot = cluster.mean - heights_m.back() * axis;
      const auto next = static_cast<std::int32_t>(lowest_m.size());
      column_of.push_back(columns.FindOrInsert(VoxelKeyOf(foot, 1.0 / kColumnM), next));
      if (column_of.back() == next) lowest_m.push_back(heights_m.back());
      double& lowest = lowest_m[static_cast<std::size_t>(column_of.back())];
      lowest = std::min(lowest, heights_m.back());
    }
  }
  const bool upwards = std::abs(axis.dot(u_)) > kAlongAxis;
  for (std::size_t i = 0; i < heights_m.size(); ++i) {
    const double ground_m = lowest_m[static_cast<std::size_t>(column_of[i])] + kGroundM;
    in_space_.push_back(upwards || heights_m[i] < ground_m ? 1 : 0);
  }
}

WayAlong SteadyMotionSearch::WayUnder(const SteadyMotion& motion) const {
  const auto at = [&](double t) {
    return motion.speed_m_s * t + 0.5 * motion.acceleration_m_s2 * t * t;
  };
  WayAlong way;
  for (const SteadyScan& scan : scans_) {
    const double t = scan.time_s - middle_s_;
    way.positions_m.push_back(at(t) - at(scans_.front().time_s - middle_s_));
    way.speeds_m_s.push_back(motion.speed_m_s + motion.acceleration_m_s2 * t);
  }
  return way;
}

void SteadyMotionSearch::AddGrid(const SteadyMotionSearch& places, const WayAlong& way,
                                 const Eigen::Vector3d& shift_m, SteadyMotionGrid* grid,
                                 Evidence* sums) const {
  const double noise2 = options_.noise_m * options_.noise_m;
  grid->Begin(block_of_.size());
  const char* is_in_space = in_space_.data();
  for (std::size_t k = 0; k < scans_.size(); ++k) {
    grid->FindVoxels(scans_[k], is_in_space, u_, way.positions_m[k], way.speeds_m_s[k], shift_m,
                     1.0 / options_.voxel_size_m);
    grid->AddScan(scans_[k], is_in_space, k);
    is_in_space += scans_[k].clusters.size();
  }
  const std::vector<PointCluster>& voxels = grid->voxels;
  std::vector<double> sharpness(voxels.size(), 0.0);
  for (std::size_t v = 0; v < voxels.size(); ++v) {
    if (grid->shared[v]) sums->shared += voxels[v].count;
    if (voxels[v].count < kLeastPoints) continue;
    const double variance =
        grid->in_space[v] != 0 ? LeastVariance(voxels[v]) : LeastVariance(voxels[v], u_, across_);
    sharpness[v] = -0.5 * std::log(variance + noise2);
  }
  std::size_t place = 0;
  for (const SteadyScan& scan : scans_) {
    for (const PointCluster& cluster : scan.clusters) {
      sums->blocks[static_cast<std::size_t>(places.block_of_[place])] +=
          cluster.count * sharpness[static_cast<std::size_t>(grid->voxel_of[place])];
      ++place;
    }
  }
}

SteadyMotionSearch::Evidence SteadyMotionSearch::EvidenceOf(const WayAlong& way, std::size_t grids,
                                                            SteadyMotionGrid* grid) const {
  return EvidenceIn(*this, way, grids, grid);
}

SteadyMotionSearch::Evidence SteadyMotionSearch::EvidenceIn(const SteadyMotionSearch& places,
                                                            const WayAlong& way, std::size_t grids,
                                                            SteadyMotionGrid* grid) const {
  Evidence sums;
  sums.blocks.resize(places.block_points_.size(), 0.0);
  for (std::size_t i = 0; i < grids; ++i)
    AddGrid(places, way, options_.voxel_size_m * Eigen::Vector3d(kShifts[i]), grid, &sums);
  for (std::size_t b = 0; b < sums.blocks.size(); ++b)
    sums.blocks[b] /= static_cast<double>(grids) * (places.block_points_[b] + kHalfPoints);
  sums.shared /= static_cast<double>(grids);
  return sums;
}

std::vector<SteadyMotionSearch::Evidence> SteadyMotionSearch::CoarseEvidence(
    const std::vector<SteadyMotion>& motions) const {
  // So many share the memory of a grid: megabytes, which else go back to the system each time.
  constexpr std::size_t kTogether = 8;
  std::vector<Evidence> evidence(motions.size());
  ParallelChunks(motions.size(), kTogether, [&](std::size_t begin, std::size_t end) {
    SteadyMotionGrid grid;
    for (std::size_t i = begin; i < end; ++i)
      evidence[i] = EvidenceOf(WayUnder(motions[i]), kCoarseGrids, &grid);
  });
  return evidence;
}

double SteadyMotionSearch::Total(const SteadyMotion& motion,
                                 const std::vector<double>& blocks) const {
  const double v = motion.speed_m_s / options_.speed_sigma_m_s;
  const double a = motion.acceleration_m_s2 / options_.acceleration_sigma_m_s2;
  return std::accumulate(blocks.begin(), blocks.end(), -0.5 * (v * v + a * a));
}

SteadyMotion SteadyMotionSearch::Climb(const SteadyMotion& start) const {
  constexpr double kLeastStepMS = 0.05, kAccelerationStepPerS = 8.0;
  std::array<SteadyMotionGrid, 4> grids;
  const auto evidence_of = [&](const SteadyMotion& motion, SteadyMotionGrid* grid) {
    return Total(motion, EvidenceOf(WayUnder(motion), kGrids, grid).blocks);
  };
  SteadyMotion best = start;
  double most = evidence_of(best, grids.data());
  for (double step = step_m_s_; step >= kLeastStepMS;) {
    const SteadyMotion from = best;
    const double faster = kAccelerationStepPerS * step;
    const std::array<SteadyMotion, 4> beside = {{
        {from.speed_m_s + step, from.acceleration_m_s2},
        {from.speed_m_s - step, from.acceleration_m_s2},
        {from.speed_m_s, from.acceleration_m_s2 + faster},
        {from.speed_m_s, from.acceleration_m_s2 - faster},
    }};
    std::array<double, 4> evidence{};
    ParallelChunks(beside.size(), 1, [&](std::size_t i, std::size_t) {
      evidence[i] = evidence_of(beside[i], &grids[i]);
    });
    const auto i = static_cast<std::size_t>(
        std::distance(evidence.begin(), std::max_element(evidence.begin(), evidence.end())));
    if (evidence[i] > most) {
      most = evidence[i];
      best = beside[i];
    } else {
      step *= 0.5;
    }
  }
  return best;
}

FoundMotion SteadyMotionSearch::Find() const {
  // Scans see mostly the same: a speed at which they have much less in common than at others is
  // none, though nothing that they see contradicts it.
  constexpr double kLeastShared = 0.5;
  // In standard deviations of the acceleration.
  constexpr double kMostFromRest = 1.5;
  const auto most_steps = static_cast<int>(most_speed_m_s_ / step_m_s_);
  const auto coarse_speed = [&](std::size_t i) {
    return step_m_s_ * (static_cast<int>(i) - most_steps);
  };
  std::vector<SteadyMotion> steady;
  for (std::size_t i = 0; i < static_cast<std::size_t>(2 * most_steps + 1); ++i)
    steady.push_back({coarse_speed(i), 0.0});
  const std::vector<Evidence> coarse = CoarseEvidence(steady);
  double most_shared = 0.0;
  for (const Evidence& evidence : coarse) most_shared = std::max(most_shared, evidence.shared);
  const auto possible = [&](const Evidence& e) { return e.shared >= kLeastShared * most_shared; };
  std::size_t best = static_cast<std::size_t>(most_steps);
  double most = -std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < coarse.size(); ++i) {
    const double total = Total(steady[i], coarse[i].blocks);
    if (total <= most || !possible(coarse[i])) continue;
    best = i;
    most = total;
  }
  // A sensor that sets off ends at twice its mean speed.
  const double duration_s = scans_.back().time_s - scans_.front().time_s;
  const double most_mean_m_s = 0.5 * kMostFromRest * options_.acceleration_sigma_m_s2 * duration_s;
  const auto most_off = static_cast<int>(std::min(most_mean_m_s, most_speed_m_s_) / step_m_s_);
  const auto from_rest = [&](std::size_t i) {
    const double mean_m_s = step_m_s_ * (static_cast<int>(i) - most_off);
    return SteadyMotion{mean_m_s, 2.0 * mean_m_s / duration_s};
  };
  SteadyMotion start = steady[best];
  std::vector<SteadyMotion> setting_off;
  for (std::size_t i = 0; i < static_cast<std::size_t>(2 * most_off + 1); ++i)
    setting_off.push_back(from_rest(i));
  const std::vector<Evidence> off = CoarseEvidence(setting_off);
  for (std::size_t i = 0; i < off.size(); ++i) {
    const double total = Total(setting_off[i], off[i].blocks);
    if (total <= most || !possible(off[i])) continue;
    start = setting_off[i];
    most = total;
  }
  std::vector<Rival> rivals;
  for (std::size_t i = 0; i < coarse.size(); ++i) {
    if (possible(coarse[i])) rivals.push_back({steady[i], coarse[i].blocks});
  }
  for (std::size_t i = 0; i < off.size(); ++i) {
    if (possible(off[i])) rivals.push_back({setting_off[i], off[i].blocks});
  }
  const SteadyMotion found = Climb(start);
  return {found, OpenSpeed(found, rivals)};
}

double SteadyMotionSearch::OpenSpeed(const SteadyMotion& motion,
                                     const std::vector<Rival>& rivals) const {
  // Speeds nearer than so many steps are told apart in all grids.
  constexpr int kNearSteps = 4;
  constexpr double kRefutedSigmas = 2.0;
  const WayAlong way = WayUnder(motion);
  SteadyMotionGrid grid;
  const std::vector<double> ours = EvidenceOf(way, kGrids, &grid).blocks;
  const std::vector<double> ours_coarse = EvidenceOf(way, kCoarseGrids, &grid).blocks;
  double open_m_s = 0.0;
  for (const Rival& rival : rivals) {
    const double apart = std::abs(rival.motion.speed_m_s - motion.speed_m_s);
    if (apart > kNearSteps * step_m_s_ && Votes(ours_coarse, rival.blocks) < kRefutedSigmas)
      open_m_s = std::max(open_m_s, apart);
  }
  for (int step = -kNearSteps; step <= kNearSteps; ++step) {
    const double apart = step_m_s_ * step;
    const SteadyMotion other = {motion.speed_m_s + apart, motion.acceleration_m_s2};
    if (step != 0 &&
        Votes(ours, EvidenceOf(WayUnder(other), kGrids, &grid).blocks) < kRefutedSigmas)
      open_m_s = std::max(open_m_s, std::abs(apart));
  }
  return open_m_s;
}

double SteadyMotionSearch::Sharper(const WayAlong& one, const WayAlong& other) const {
  SteadyMotionGrid grid;
  return Votes(EvidenceOf(one, kGrids, &grid).blocks, EvidenceOf(other, kGrids, &grid).blocks);
}

double SteadyMotionSearch::Sharper(const WayAlong& one, const SteadyMotionSearch& from,
                                   const WayAlong& other) const {
  SteadyMotionGrid grid;
  return Votes(EvidenceOf(one, kGrids, &grid).blocks,
               from.EvidenceIn(*this, other, kGrids, &grid).blocks);
}

}  // namespace lamina
