#include "frontend/scan_agreement.h"

namespace lamina {

bool ScansAgree(const std::vector<PointCluster>& a, const std::vector<PointCluster>& b,
                const PosePrediction& T_a_b, const VoxelMapOptions& map_options,
                const ScanMatcher& matcher) {
  constexpr double kLeastFit = 0.7, kLeastOverlap = 0.3;
  VoxelMap map(map_options);
  for (const PointCluster& cluster : a) {
    if (map.CanHold(cluster.mean)) map.AddWindow(map.LeafAt(cluster.mean), cluster, 0);
  }
  map.Refresh();
  const MatchResult match = matcher.Match(b, T_a_b, map);
  return match.status != MatchResult::Status::kTooFewMatches && match.fit() >= kLeastFit &&
         match.overlap() >= kLeastOverlap;
}

}  // namespace lamina
