#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "core/geometry/robust_kernel.h"
#include "frontend/matching/block_votes.h"
#include "frontend/start/start_track.h"

namespace lamina {

double StartTrack::Better(const Hypothesis& a, const Hypothesis& b) const {
  BlockDifferences differences;
  std::size_t i = 0;
  for (std::size_t k = 1; k < scans_.size(); ++k) {
    for (const TimedCluster& cluster : scans_[k].clusters) {
      if (a.fits[i] >= 0.0F && b.fits[i] >= 0.0F)
        differences.Add(cluster.points.mean, static_cast<double>(a.fits[i] - b.fits[i]));
      ++i;
    }
  }
  const double squared =
      ClearSquared(differences.Sigmas(), Unsteadiness(b.poses) - Unsteadiness(a.poses));
  return std::copysign(std::sqrt(std::abs(squared)), squared);
}

double StartTrack::ChangeVariance(std::size_t scan, double pose_m) const {
  const double before_s = scans_.GapS(scan - 1), after_s = scans_.GapS(scan);
  const double sigma = steady_.acceleration_sigma_m_s2 * 0.5 * (before_s + after_s);
  return sigma * sigma + pose_m * pose_m *
                             (std::pow(1.0 / before_s + 1.0 / after_s, 2) +
                              1.0 / (before_s * before_s) + 1.0 / (after_s * after_s));
}

double StartTrack::Unsteadiness(const std::vector<SE3>& poses) const {
  // Standard deviations of a pose along u: of a match, and of a shaken sensor about its steady way.
  constexpr double kMatchM = 0.01, kShakenM = 0.03;
  const double pose_m = seen_.shaken ? kShakenM : kMatchM;
  const auto speed = [&](std::size_t k) {
    return u_.dot(poses[k].t - poses[k - 1].t) / scans_.GapS(k);
  };
  double sum = 0.0;
  for (std::size_t k = 2; k < poses.size(); ++k) {
    const double change = speed(k) - speed(k - 1);
    sum += CauchyCost(change * change / ChangeVariance(k, pose_m));
  }
  return sum;
}

bool StartTrack::Steady(const std::vector<SE3>& poses) const {
  // Mean cost of a change of speed: about 1 for motion as the options expect it, 4 to 7 for chance
  // poses.
  constexpr double kMost = 2.0;
  return poses.size() < 3 || Unsteadiness(poses) < kMost * static_cast<double>(poses.size() - 2);
}

bool StartTrack::SameWay(const std::vector<SE3>& a, const std::vector<SE3>& b) {
  for (std::size_t k = 0; k < std::min(a.size(), b.size()); ++k) {
    if ((a[k].t - b[k].t).norm() > kSameWayM) return false;
  }
  return true;
}

void StartTrack::Rank() {
  constexpr double kClearSigmas = 3.0;
  std::size_t best = 0;
  for (std::size_t i = 1; i < hypotheses_.size(); ++i) {
    if (Better(hypotheses_[i], hypotheses_[best]) > 0.0) best = i;
  }
  std::vector<std::pair<double, std::size_t>> behind;
  for (std::size_t i = 0; i < hypotheses_.size(); ++i)
    behind.emplace_back(i == best ? 0.0 : Better(hypotheses_[best], hypotheses_[i]), i);
  std::swap(behind[0], behind[best]);
  std::stable_sort(behind.begin() + 1, behind.end());
  std::vector<Hypothesis> left;
  for (const auto& [sigmas, i] : behind) {
    const Hypothesis& h = hypotheses_[i];
    const bool known = std::any_of(left.begin(), left.end(), [&](const Hypothesis& other) {
      return SameWay(h.poses, other.poses);
    });
    if (!known && sigmas <= kClearSigmas && left.size() < kMostHypotheses) left.push_back(h);
  }
  hypotheses_ = std::move(left);
}

}  // namespace lamina
