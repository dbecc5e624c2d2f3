#include "frontend/pairwise/fast_global_registration.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <random>

#include "core/geometry/robust_kernel.h"

namespace lamina {
namespace {

// Centred and scaled to unit radius, as the paper does before anything else.
struct Normalised {
  std::vector<FeatureMatch> matches;
  Eigen::Vector3d source_mean = Eigen::Vector3d::Zero(), target_mean = Eigen::Vector3d::Zero();
  double scale = 0.0;
};

Normalised Normalise(const std::vector<FeatureMatch>& matches) {
  Normalised out;
  out.matches = matches;
  const auto n = static_cast<double>(matches.size());
  for (const FeatureMatch& m : matches) {
    out.source_mean += m.source / n;
    out.target_mean += m.target / n;
  }
  for (FeatureMatch& m : out.matches) {
    m.source -= out.source_mean;
    m.target -= out.target_mean;
    out.scale = std::max({out.scale, m.source.norm(), m.target.norm()});
  }
  for (FeatureMatch& m : out.matches) {
    m.source /= out.scale;
    m.target /= out.scale;
  }
  return out;
}

// One Gauss-Newton step at T; the line process is at its optimum.
Vector6d Step(const std::vector<FeatureMatch>& matches, const SE3& T, double mu) {
  Matrix6d H = Matrix6d::Zero();
  Vector6d g = Vector6d::Zero();
  const Eigen::Matrix3d R = T.R();
  for (const FeatureMatch& m : matches) {
    const Eigen::Vector3d r = R * m.source + T.t - m.target;
    const double weight = GemanMcClureWeight(r.squaredNorm() / mu);
    Eigen::Matrix<double, 3, 6> J;
    J << -R * Hat(m.source), Eigen::Matrix3d::Identity();
    H.noalias() += weight * J.transpose() * J;
    g.noalias() += weight * J.transpose() * r;
  }
  H += 1e-9 * Matrix6d::Identity();
  return -H.ldlt().solve(g);
}

class FastGlobal final : public PairwiseMethod {
 public:
  explicit FastGlobal(const PairwiseOptions& options) : options_(options) {}
  void Prepare(PairwiseCloud* cloud) const override { PrepareFeatures(options_, cloud); }
  PairwiseResult Register(const PairwiseCloud& source, const PairwiseCloud& target,
                          const SE3&) const override {
    PairwiseResult result;
    result.reason = FeatureFault(source, target);
    if (!result.reason.empty()) return result;
    // Wrong matches cost this method little: it takes as many again as a clique could.
    const auto most = static_cast<std::size_t>(4 * options_.max_matches);
    return SolveFastGlobal(TupleTest(MutualMatches(source, target, most)),
                           options_.feature_noise_voxels * options_.feature_voxel_m,
                           options_.min_consistent);
  }

 private:
  PairwiseOptions options_;
};

}  // namespace

std::vector<FeatureMatch> TupleTest(const std::vector<FeatureMatch>& matches) {
  constexpr double kSimilarity = 0.9;
  constexpr std::size_t kTriesEach = 100, kMostTuples = 1000;
  std::vector<FeatureMatch> passed;
  if (matches.size() < 3) return passed;
  std::vector<bool> taken(matches.size());
  std::mt19937 random(1);
  std::size_t tuples = 0;
  for (std::size_t i = 0; i < kTriesEach * matches.size() && tuples < kMostTuples; ++i) {
    std::array<std::size_t, 3> triple;
    for (std::size_t& t : triple) t = random() % matches.size();
    bool good = true;
    for (std::size_t e = 0; e < 3; ++e) {
      const FeatureMatch& a = matches[triple[e]];
      const FeatureMatch& b = matches[triple[(e + 1) % 3]];
      const double from = (a.source - b.source).norm();
      const double to = (a.target - b.target).norm();
      good = good && from > kSimilarity * to && to > kSimilarity * from;
    }
    if (!good) continue;
    ++tuples;
    for (const std::size_t t : triple) {
      if (!taken[t]) passed.push_back(matches[t]);
      taken[t] = true;
    }
  }
  return passed;
}

PairwiseResult SolveFastGlobal(const std::vector<FeatureMatch>& matches, double noise_m,
                               int min_consistent) {
  PairwiseResult result;
  const auto too_few = [&](int count) {
    result.reason = std::to_string(count) + " of " + std::to_string(matches.size()) +
                    " matches agree, at least " + std::to_string(min_consistent) + " must";
    return count < min_consistent;
  };
  if (too_few(static_cast<int>(matches.size()))) return result;
  const Normalised normalised = Normalise(matches);
  if (!(normalised.scale > 0.0)) return result;
  const double least = std::pow(noise_m / normalised.scale, 2);
  constexpr int kMaxSteps = 100;
  SE3 T;
  double mu = 1.0;
  for (; result.iterations < kMaxSteps; ++result.iterations) {
    if (result.iterations % 4 == 0 && mu > least) mu = std::max(least, mu / 1.4);
    const Vector6d step = Step(normalised.matches, T, mu);
    T = Retract(T, step);
    if (mu <= least && step.norm() < 1e-7) break;
  }
  result.T_target_source =
      SE3(T.q, normalised.scale * T.t + normalised.target_mean - T.q * normalised.source_mean);
  for (const FeatureMatch& m : matches) {
    if ((m.target - result.T_target_source * m.source).norm() <= 2.0 * noise_m) ++result.inliers;
  }
  result.good = !too_few(result.inliers);
  if (result.good) result.reason.clear();
  return result;
}

std::unique_ptr<PairwiseMethod> MakeFastGlobalRegistration(const PairwiseOptions& options) {
  return std::make_unique<FastGlobal>(options);
}

}  // namespace lamina
