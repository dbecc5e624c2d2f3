#include "frontend/pairwise/teaser.h"

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "core/base/thinning.h"
#include "frontend/pairwise/maximum_clique.h"

namespace lamina {
namespace {

// Differences of a member to those that follow it, at most so many each: enough to average over.
constexpr std::size_t kDifferencesEach = 10;

std::vector<FeatureMatch> ConsistentMatches(const std::vector<FeatureMatch>& matches,
                                            double noise_m) {
  std::vector<std::pair<std::size_t, std::size_t>> edges;
  for (std::size_t i = 0; i < matches.size(); ++i) {
    for (std::size_t j = i + 1; j < matches.size(); ++j) {
      const double a = (matches[i].source - matches[j].source).norm();
      const double b = (matches[i].target - matches[j].target).norm();
      if (std::abs(a - b) <= 2.0 * noise_m) edges.emplace_back(i, j);
    }
  }
  std::vector<FeatureMatch> consistent;
  for (const std::size_t i : MaximumClique(matches.size(), edges)) consistent.push_back(matches[i]);
  return consistent;
}

std::vector<FeatureMatch> Differences(const std::vector<FeatureMatch>& matches) {
  std::vector<FeatureMatch> differences;
  const std::size_t n = matches.size();
  for (std::size_t i = 0; i < n; ++i) {
    // Spread over the set, so that long differences, which tell a rotation best, are among them.
    const std::size_t stride = StrideToAtLeast(n, kDifferencesEach);
    for (std::size_t step = 1; step < n; step += stride) {
      const std::size_t j = (i + step) % n;
      differences.push_back(
          {matches[j].source - matches[i].source, matches[j].target - matches[i].target});
    }
  }
  return differences;
}

Eigen::Matrix3d RobustRotation(const std::vector<FeatureMatch>& differences, double bound) {
  constexpr int kMaxSteps = 100;
  constexpr double kGrowth = 1.4;
  const double c2 = bound * bound;
  std::vector<double> weights(differences.size(), 1.0), r2(differences.size());
  double mu = 0.0, last_cost = std::numeric_limits<double>::max();
  Eigen::Matrix3d R = Eigen::Matrix3d::Identity();
  for (int step = 0; step < kMaxSteps; ++step) {
    R = WeightedRotation(differences, weights);
    double cost = 0.0;
    for (std::size_t k = 0; k < r2.size(); ++k) {
      r2[k] = (differences[k].target - R * differences[k].source).squaredNorm();
      cost += weights[k] * r2[k];
    }
    if (step == 0) {
      const double worst = *std::max_element(r2.begin(), r2.end());
      if (2.0 * worst <= c2) break;  // all are inliers
      mu = 1.0 / (2.0 * worst / c2 - 1.0);
    }
    for (std::size_t k = 0; k < r2.size(); ++k) {
      if (r2[k] >= (mu + 1.0) / mu * c2) {
        weights[k] = 0.0;
      } else if (r2[k] <= mu / (mu + 1.0) * c2) {
        weights[k] = 1.0;
      } else {
        weights[k] = std::sqrt(c2 * mu * (mu + 1.0) / r2[k]) - mu;
      }
    }
    if (std::abs(last_cost - cost) < 1e-6 * c2) break;
    last_cost = cost;
    mu *= kGrowth;
  }
  return R;
}

class Teaser final : public PairwiseMethod {
 public:
  explicit Teaser(const PairwiseOptions& options) : options_(options) {}
  void Prepare(PairwiseCloud* cloud) const override { PrepareFeatures(options_, cloud); }
  PairwiseResult Register(const PairwiseCloud& source, const PairwiseCloud& target,
                          const SE3&) const override {
    PairwiseResult result;
    result.reason = FeatureFault(source, target);
    if (!result.reason.empty()) return result;
    return SolveTeaser(
        MutualMatches(source, target, static_cast<std::size_t>(options_.max_matches)),
        options_.feature_noise_voxels * options_.feature_voxel_m, options_.min_consistent);
  }

 private:
  PairwiseOptions options_;
};

}  // namespace

Eigen::Matrix3d WeightedRotation(const std::vector<FeatureMatch>& differences,
                                 const std::vector<double>& weights) {
  Eigen::Matrix3d H = Eigen::Matrix3d::Zero();
  for (std::size_t k = 0; k < differences.size(); ++k) {
    H += weights[k] * differences[k].target * differences[k].source.transpose();
  }
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(H, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Vector3d sign = Eigen::Vector3d::Ones();
  sign.z() = (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0.0 ? -1.0 : 1.0;
  return svd.matrixU() * sign.asDiagonal() * svd.matrixV().transpose();
}

double VoteAdaptively(const std::vector<double>& values, double bound) {
  std::vector<std::pair<double, double>> ends;  // place, and the value whose interval starts (+)
  for (const double v : values) {
    ends.emplace_back(v - bound, v);
    ends.emplace_back(v + bound, std::numeric_limits<double>::quiet_NaN());
  }
  std::sort(ends.begin(), ends.end(),
            [](const auto& a, const auto& b) { return a.first < b.first; });
  double best = values.empty() ? 0.0 : values[0];
  double best_cost = std::numeric_limits<double>::max();
  // Sums over the intervals that are open, relative to the first value for the sake of digits.
  double n = 0.0, sum = 0.0, sum2 = 0.0;
  const double origin = best;
  for (const auto& [place, start] : ends) {
    const double sign = std::isnan(start) ? -1.0 : 1.0;
    const double v = (std::isnan(start) ? place - bound : start) - origin;
    n += sign, sum += sign * v, sum2 += sign * v * v;
    if (n < 0.5) continue;
    const double mean = sum / n;
    const double outside = static_cast<double>(values.size()) - n;
    const double cost = sum2 - n * mean * mean + outside * bound * bound;
    if (cost < best_cost) {
      best_cost = cost;
      best = origin + mean;
    }
  }
  return best;
}

PairwiseResult SolveTeaser(const std::vector<FeatureMatch>& matches, double noise_m,
                           int min_consistent) {
  PairwiseResult result;
  const std::vector<FeatureMatch> clique = ConsistentMatches(matches, noise_m);
  const auto too_few = [&](std::size_t count) {
    result.reason = std::to_string(count) + " of " + std::to_string(matches.size()) +
                    " matches agree, at least " + std::to_string(min_consistent) + " must";
    return count < static_cast<std::size_t>(min_consistent);
  };
  if (too_few(clique.size())) return result;
  const Eigen::Matrix3d R = RobustRotation(Differences(clique), 2.0 * noise_m);
  Eigen::Vector3d t;
  for (int axis = 0; axis < 3; ++axis) {
    std::vector<double> values;
    for (const FeatureMatch& m : clique) values.push_back((m.target - R * m.source)(axis));
    t(axis) = VoteAdaptively(values, noise_m);
  }
  std::size_t inliers = 0;
  for (const FeatureMatch& m : clique) {
    if ((m.target - R * m.source - t).norm() <= 2.0 * noise_m) ++inliers;
  }
  if (too_few(inliers)) return result;
  result.good = true;
  result.reason.clear();
  result.T_target_source = SE3(R, t);
  result.inliers = static_cast<int>(inliers);
  return result;
}

std::unique_ptr<PairwiseMethod> MakeTeaser(const PairwiseOptions& options) {
  return std::make_unique<Teaser>(options);
}

}  // namespace lamina
