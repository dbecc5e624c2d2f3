#include "tools/compare/global_synchronisation.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace lamina {
namespace {

// Of the points of either, the smaller share.
double Overlap(const std::vector<Eigen::Vector3f>& source,
               const std::vector<Eigen::Vector3f>& target, const SE3& T_target_source) {
  constexpr double kVoxelM = 0.3;
  return std::min(OverlapShare(source, target, T_target_source, kVoxelM),
                  OverlapShare(target, source, T_target_source.Inverse(), kVoxelM));
}

class Registrations {
 public:
  Registrations(const PairwiseMethod& method, const std::vector<PairwiseCloud>& clouds)
      : method_(method), clouds_(clouds) {}

  // T_a_b; adds an edge if it is good. Matches that agree may still be of one pillar with the next:
  // then less of the scans overlaps, and the edge weighs little.
  PairwiseResult Register(std::size_t a, std::size_t b) {
    ++tried_;
    const PairwiseResult result = method_.Register(clouds_[b], clouds_[a], SE3());
    if (result.good) {
      const double overlap = Overlap(clouds_[b].points, clouds_[a].points, result.T_target_source);
      edges_.push_back({a, b, result.T_target_source, result.inliers * std::pow(overlap, 4)});
    }
    return result;
  }

  const std::vector<PoseGraphEdge>& edges() const { return edges_; }
  std::size_t tried() const { return tried_; }

 private:
  const PairwiseMethod& method_;
  const std::vector<PairwiseCloud>& clouds_;
  std::vector<PoseGraphEdge> edges_;
  std::size_t tried_ = 0;
};

PairwiseSequenceResult ChainNeighbours(std::size_t scans, Registrations* registrations,
                                       const PairwiseProgress& progress) {
  PairwiseSequenceResult chain;
  chain.poses.emplace_back();
  progress();
  for (std::size_t k = 1; k < scans; ++k) {
    const PairwiseResult match = registrations->Register(k - 1, k);
    if (!match.good && chain.reason.empty()) {
      chain.reason = "scan " + std::to_string(k) + " against scan " + std::to_string(k - 1) + ": " +
                     match.reason;
    }
    if (chain.reason.empty()) chain.poses.push_back(chain.poses.back() * match.T_target_source);
    progress();
  }
  chain.good = chain.reason.empty();
  return chain;
}

// Pairs more than `near` apart, by scan and overlap.
std::vector<std::pair<std::size_t, std::size_t>> FarPairs(const std::vector<PairwiseCloud>& clouds,
                                                          const std::vector<SE3>& poses,
                                                          const SynchronisationOptions& options) {
  constexpr double kCoarseM = 0.3;
  std::vector<std::vector<Eigen::Vector3f>> coarse;
  for (const PairwiseCloud& cloud : clouds) coarse.push_back(Downsample(cloud.points, kCoarseM));
  std::vector<std::pair<std::size_t, std::size_t>> pairs;
  for (std::size_t b = 0; b < clouds.size(); ++b) {
    std::vector<std::pair<double, std::size_t>> overlapping;
    for (std::size_t a = 0; a + static_cast<std::size_t>(options.near) < b; ++a) {
      const double overlap = Overlap(coarse[b], coarse[a], poses[a].Inverse() * poses[b]);
      if (overlap > options.min_overlap) overlapping.emplace_back(-overlap, a);
    }
    std::sort(overlapping.begin(), overlapping.end());
    const auto most = static_cast<std::size_t>(options.pairs_per_scan);
    for (std::size_t i = 0; i < std::min(most, overlapping.size()); ++i) {
      pairs.emplace_back(overlapping[i].second, b);
    }
  }
  return pairs;
}

}  // namespace

void SynchronisationOptions::Visit(OptionVisitor& v) {
  v.Integer("near", &near, 1, 100);
  v.Number("min_overlap", &min_overlap, 0.0, 1.0);
  v.Integer("pairs_per_scan", &pairs_per_scan, 0, 1000);
  v.Group("graph", &graph);
}

SynchronisationResult RegisterGlobally(
    const PairwiseMethod& method, const std::vector<PairwiseCloud>& clouds,
    const SynchronisationOptions& options, const PairwiseProgress& progress,
    const std::function<void(const PairwiseSequenceResult&)>& on_chain) {
  CheckOptions(options, "synchronisation");
  SynchronisationResult result;
  Registrations registrations(method, clouds);
  result.chain = ChainNeighbours(clouds.size(), &registrations, progress);
  on_chain(result.chain);
  for (std::size_t b = 2; b < clouds.size(); ++b) {
    for (std::size_t apart = 2; apart <= std::min(b, static_cast<std::size_t>(options.near));
         ++apart) {
      registrations.Register(b - apart, b);
    }
  }
  PoseGraphResult graph = SpanningTreePoses(clouds.size(), registrations.edges());
  // Scans that nothing joins to the others yet may be joined from farther off.
  const auto farthest = static_cast<std::size_t>(3 * options.near);
  for (auto apart = static_cast<std::size_t>(options.near) + 1; !graph.good && apart <= farthest;
       ++apart) {
    for (std::size_t b = apart; b < clouds.size(); ++b) registrations.Register(b - apart, b);
    graph = SpanningTreePoses(clouds.size(), registrations.edges());
  }
  if (graph.good) {
    for (const auto& [a, b] : FarPairs(clouds, graph.poses, options)) registrations.Register(a, b);
    graph = SolvePoseGraph(clouds.size(), registrations.edges(), options.graph);
  }
  for (std::size_t k = 0; k < clouds.size(); ++k) progress();
  result.synchronised = {graph.good, graph.reason, graph.poses};
  result.pairs = registrations.tried();
  result.registered = registrations.edges().size();
  result.rejected = graph.rejected;
  return result;
}

}  // namespace lamina
