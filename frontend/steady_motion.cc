#include "frontend/steady_motion.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <numeric>
#include <utility>

#include "core/base/parallel.h"
#include "core/map/voxel_key.h"

namespace lamina {
namespace {

constexpr double kBlockM = 4.0;
// Points with which a block counts half.
constexpr double kHalfPoints = 20.0;
// Fewer points are no voxel.
constexpr double kLeastPoints = 5.0;
constexpr double kStepMS = 0.5;

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

double Votes(const std::vector<double>& one, const std::vector<double>& other) {
  double sum = 0.0, squares = 0.0;
  for (std::size_t b = 0; b < one.size(); ++b) {
    const double difference = one[b] - other[b];
    const double vote = difference / std::hypot(1.0, difference);
    sum += vote;
    squares += vote * vote;
  }
  return squares > 0.0 ? sum / std::sqrt(squares) : 0.0;
}

}  // namespace

SteadyMotionSearch::SteadyMotionSearch(const SteadyMotionOptions& options, const Eigen::Vector3d& u,
                                       std::vector<SteadyScan> scans)
    : options_(options), u_(u), scans_(std::move(scans)) {
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
  middle_s_ = 0.5 * (scans_.front().time_s + scans_.back().time_s);
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

void SteadyMotionSearch::AddGrid(const WayAlong& way, const Eigen::Vector3d& shift_m,
                                 std::vector<double>* sums) const {
  const double noise2 = options_.noise_m * options_.noise_m;
  VoxelIndex index(block_of_.size() / 4);
  std::vector<PointCluster> voxels;
  std::vector<std::int32_t> voxel_of(block_of_.size());
  std::size_t place = 0;
  for (std::size_t k = 0; k < scans_.size(); ++k) {
    const SteadyScan& scan = scans_[k];
    for (std::size_t i = 0; i < scan.clusters.size(); ++i, ++place) {
      PointCluster cluster = scan.clusters[i];
      const double during_m =
          scan.cluster_times_s.empty() ? 0.0 : way.speeds_m_s[k] * scan.cluster_times_s[i];
      cluster.mean += (way.positions_m[k] + during_m) * u_;
      voxel_of[place] =
          index.FindOrInsert(VoxelKeyOf(cluster.mean + shift_m, 1.0 / options_.voxel_size_m),
                             static_cast<std::int32_t>(voxels.size()));
      const auto voxel = static_cast<std::size_t>(voxel_of[place]);
      if (voxel == voxels.size()) voxels.emplace_back();
      voxels[voxel] += cluster;
    }
  }
  std::vector<double> sharpness(voxels.size(), 0.0);
  for (std::size_t v = 0; v < voxels.size(); ++v) {
    if (voxels[v].count >= kLeastPoints)
      sharpness[v] = -0.5 * std::log(LeastVariance(voxels[v]) + noise2);
  }
  place = 0;
  for (const SteadyScan& scan : scans_) {
    for (const PointCluster& cluster : scan.clusters) {
      (*sums)[static_cast<std::size_t>(block_of_[place])] +=
          cluster.count * sharpness[static_cast<std::size_t>(voxel_of[place])];
      ++place;
    }
  }
}

std::vector<double> SteadyMotionSearch::BlockEvidence(const WayAlong& way,
                                                      std::size_t grids) const {
  std::vector<double> sums(block_points_.size(), 0.0);
  for (std::size_t grid = 0; grid < grids; ++grid)
    AddGrid(way, options_.voxel_size_m * Eigen::Vector3d(kShifts[grid]), &sums);
  for (std::size_t b = 0; b < sums.size(); ++b)
    sums[b] /= static_cast<double>(grids) * (block_points_[b] + kHalfPoints);
  return sums;
}

double SteadyMotionSearch::Total(const SteadyMotion& motion,
                                 const std::vector<double>& blocks) const {
  const double v = motion.speed_m_s / options_.speed_sigma_m_s;
  const double a = motion.acceleration_m_s2 / options_.acceleration_sigma_m_s2;
  return std::accumulate(blocks.begin(), blocks.end(), -0.5 * (v * v + a * a));
}

SteadyMotion SteadyMotionSearch::Climb(const SteadyMotion& start) const {
  constexpr double kLeastStepMS = 0.05, kAccelerationStepPerS = 8.0;
  const auto evidence_of = [&](const SteadyMotion& motion) {
    return Total(motion, BlockEvidence(WayUnder(motion), kGrids));
  };
  SteadyMotion best = start;
  double most = evidence_of(best);
  for (double step = kStepMS; step >= kLeastStepMS;) {
    const SteadyMotion from = best;
    const double faster = kAccelerationStepPerS * step;
    const std::array<SteadyMotion, 4> beside = {{
        {from.speed_m_s + step, from.acceleration_m_s2},
        {from.speed_m_s - step, from.acceleration_m_s2},
        {from.speed_m_s, from.acceleration_m_s2 + faster},
        {from.speed_m_s, from.acceleration_m_s2 - faster},
    }};
    std::array<double, 4> evidence{};
    ParallelChunks(beside.size(), 1,
                   [&](std::size_t i, std::size_t) { evidence[i] = evidence_of(beside[i]); });
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
  // Speeds nearer than so many steps are told apart in all grids.
  constexpr int kNearSteps = 4;
  constexpr double kRefutedSigmas = 2.0;
  const auto most_steps = static_cast<int>(options_.most_speed_m_s / kStepMS);
  const auto coarse_speed = [&](std::size_t i) {
    return kStepMS * (static_cast<int>(i) - most_steps);
  };
  std::vector<std::vector<double>> coarse(static_cast<std::size_t>(2 * most_steps + 1));
  ParallelChunks(coarse.size(), 1, [&](std::size_t i, std::size_t) {
    coarse[i] = BlockEvidence(WayUnder({coarse_speed(i), 0.0}), kCoarseGrids);
  });
  std::size_t best = 0;
  double most = -std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < coarse.size(); ++i) {
    const double total = Total({coarse_speed(i), 0.0}, coarse[i]);
    if (total > most) best = i;
    most = std::max(most, total);
  }
  FoundMotion found;
  found.motion = Climb({coarse_speed(best), 0.0});
  const std::vector<double> ours = BlockEvidence(WayUnder(found.motion), kGrids);
  const std::vector<double> ours_coarse = BlockEvidence(WayUnder(found.motion), kCoarseGrids);
  for (std::size_t i = 0; i < coarse.size(); ++i) {
    const double apart = std::abs(coarse_speed(i) - found.motion.speed_m_s);
    if (apart > kNearSteps * kStepMS && Votes(ours_coarse, coarse[i]) < kRefutedSigmas)
      found.open_speed_m_s = std::max(found.open_speed_m_s, apart);
  }
  for (int step = -kNearSteps; step <= kNearSteps; ++step) {
    const double apart = kStepMS * step;
    const SteadyMotion other = {found.motion.speed_m_s + apart, found.motion.acceleration_m_s2};
    if (step != 0 && Votes(ours, BlockEvidence(WayUnder(other), kGrids)) < kRefutedSigmas)
      found.open_speed_m_s = std::max(found.open_speed_m_s, std::abs(apart));
  }
  return found;
}

double SteadyMotionSearch::Sharper(const WayAlong& one, const WayAlong& other) const {
  return Votes(BlockEvidence(one, kGrids), BlockEvidence(other, kGrids));
}

}  // namespace lamina
