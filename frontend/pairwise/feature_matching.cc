#include "frontend/pairwise/feature_matching.h"

#include <algorithm>
#include <limits>

#include "frontend/pairwise/pcl_registration.h"

namespace lamina {
namespace {

struct Nearest {
  Eigen::Index index = 0;
  float first2 = std::numeric_limits<float>::max();  // squared distances
  float second2 = std::numeric_limits<float>::max();
};

void Offer(float distance2, Eigen::Index index, Nearest* nearest) {
  if (distance2 < nearest->first2) {
    nearest->second2 = nearest->first2;
    nearest->first2 = distance2;
    nearest->index = index;
  } else if (distance2 < nearest->second2) {
    nearest->second2 = distance2;
  }
}

// Distances by |a - b|^2 = |a|^2 + |b|^2 - 2 a'b, block by block: matrix products are far faster
// than any tree in 33 dimensions.
void FindNearest(const PairwiseCloud& source, const PairwiseCloud& target,
                 std::vector<Nearest>* of_source, std::vector<Nearest>* of_target) {
  const auto& a = source.features;
  const auto& b = target.features;
  of_source->assign(static_cast<std::size_t>(a.cols()), {});
  of_target->assign(static_cast<std::size_t>(b.cols()), {});
  const Eigen::VectorXf a2 = a.colwise().squaredNorm();
  const Eigen::VectorXf b2 = b.colwise().squaredNorm();
  constexpr Eigen::Index kBlock = 256;
  Eigen::MatrixXf product;
  for (Eigen::Index begin = 0; begin < a.cols(); begin += kBlock) {
    const Eigen::Index count = std::min(kBlock, a.cols() - begin);
    product.noalias() = b.transpose() * a.middleCols(begin, count);
    for (Eigen::Index i = 0; i < count; ++i) {
      Nearest& nearest = (*of_source)[static_cast<std::size_t>(begin + i)];
      for (Eigen::Index j = 0; j < b.cols(); ++j) {
        const float distance2 = std::max(0.0F, a2(begin + i) + b2(j) - 2.0F * product(j, i));
        Offer(distance2, j, &nearest);
        Offer(distance2, begin + i, &(*of_target)[static_cast<std::size_t>(j)]);
      }
    }
  }
}

}  // namespace

std::vector<FeatureMatch> MutualMatches(const PairwiseCloud& source, const PairwiseCloud& target,
                                        std::size_t most) {
  std::vector<Nearest> of_source, of_target;
  FindNearest(source, target, &of_source, &of_target);
  struct Candidate {
    float ratio;
    std::size_t source, target;
  };
  std::vector<Candidate> candidates;
  for (std::size_t i = 0; i < of_source.size() && !of_target.empty(); ++i) {
    const auto j = static_cast<std::size_t>(of_source[i].index);
    if (static_cast<std::size_t>(of_target[j].index) != i) continue;
    candidates.push_back({of_source[i].first2 / (of_source[i].second2 + 1e-6F), i, j});
  }
  std::sort(candidates.begin(), candidates.end(), [](const Candidate& a, const Candidate& b) {
    return a.ratio != b.ratio ? a.ratio < b.ratio : a.source < b.source;
  });
  if (candidates.size() > most) candidates.resize(most);
  std::sort(candidates.begin(), candidates.end(),
            [](const Candidate& a, const Candidate& b) { return a.source < b.source; });
  std::vector<FeatureMatch> matches;
  for (const Candidate& c : candidates) {
    matches.push_back({source.feature_points[c.source].cast<double>(),
                       target.feature_points[c.target].cast<double>()});
  }
  return matches;
}

void PrepareFeatures(const PairwiseOptions& options, PairwiseCloud* cloud) {
  // Normals of a plane seen with noise differ by a degree or two: 1e-3.
  constexpr double kLeastFacing = 3e-3;
  if (AddFeatures(options, cloud) < kLeastFacing) {
    cloud->feature_points.clear();
    cloud->features.resize(33, 0);
  }
}

std::string FeatureFault(const PairwiseCloud& source, const PairwiseCloud& target) {
  for (const PairwiseCloud* cloud : {&source, &target}) {
    if (cloud->feature_points.empty()) {
      return std::string(cloud == &source ? "the scan" : "the scan matched to") +
             " has no features: its surfaces do not face all directions";
    }
  }
  return "";
}

}  // namespace lamina
