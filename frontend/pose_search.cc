#include "frontend/pose_search.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

#include "core/parallel.h"

namespace lamina {
namespace {

// Steps of a grid to either side of its middle.
int StepsIn(double range, double step) { return static_cast<int>(std::floor(range / step + 1e-9)); }

// Poses that are another place, not another start into the same minimum.
bool Apart(const SE3& a, const SE3& b) {
  constexpr double kApartM = 0.75, kApartRad = 0.07;
  return (a.t - b.t).norm() > kApartM || RotationAngle(a, b) > kApartRad;
}

}  // namespace

void PoseSearchOptions::Visit(OptionVisitor& v) {
  v.Flag("enabled", &enabled);
  v.Number("trigger_rotation_deg", &trigger_rotation_deg, 0.0, 180.0);
  v.Number("trigger_translation_m", &trigger_translation_m, 0.0, 1e3);
  v.Number("trigger_inlier_ratio", &trigger_inlier_ratio, 0.0, 10.0);
  v.Number("range_deg", &range_deg, 0.0, 60.0);
  v.Number("step_deg", &step_deg, 0.5, 60.0);
  v.Number("range_m", &range_m, 0.0, 20.0);
  v.Number("step_m", &step_m, 0.05, 20.0);
  v.Number("max_way_m", &max_way_m, 0.0, 200.0);
  v.Integer("clusters", &clusters, 10, 100000);
  v.Number("score_scale_m", &score_scale_m, 0.001, 10.0);
  v.Integer("refined", &refined, 1, 1000);
}

std::vector<SE3> PoseSearch::TurnsAbout(const std::vector<SE3>& centres) const {
  const int steps = StepsIn(options_.range_deg, options_.step_deg);
  std::vector<SE3> hypotheses;
  for (const SE3& centre : centres) {
    for (int x = -steps; x <= steps; ++x) {
      for (int y = -steps; y <= steps; ++y) {
        for (int z = -steps; z <= steps; ++z) {
          const Eigen::Vector3d w = options_.step_deg * M_PI / 180.0 * Eigen::Vector3d(x, y, z);
          hypotheses.emplace_back(centre.q * ExpSO3(w), centre.t);
        }
      }
    }
  }
  return hypotheses;
}

std::vector<SE3> PoseSearch::OffsetsAbout(const SE3& centre) const {
  const int steps = StepsIn(options_.range_m, options_.step_m);
  std::vector<SE3> hypotheses;
  for (int x = -steps; x <= steps; ++x) {
    for (int y = -steps; y <= steps; ++y) {
      const Eigen::Vector3d offset(options_.step_m * x, options_.step_m * y, 0.0);
      hypotheses.emplace_back(centre.q, centre * offset);
    }
  }
  return hypotheses;
}

std::vector<SE3> PoseSearch::AlongTheWay(const PosePrediction& prediction,
                                         const Eigen::Vector3d& way, double way_m) const {
  constexpr double kSigmas = 2.5;
  // A turn that was not predicted leads to the side by a part of the way.
  constexpr double kSideways = 0.15;
  const double sigma = std::sqrt(prediction.covariance.diagonal().tail<3>().maxCoeff());
  const double turn_sigma = std::sqrt(prediction.covariance.diagonal().head<3>().maxCoeff());
  const double reach = std::min(kSigmas * sigma, options_.max_way_m);
  std::vector<SE3> hypotheses;
  if (reach < options_.step_m) return hypotheses;
  const SE3& centre = prediction.T_world_lidar;
  const Eigen::Vector3d up = centre.q * Eigen::Vector3d::UnitZ();
  const Eigen::Vector3d side = up.cross(way).normalized();
  const int steps = StepsIn(reach, options_.step_m);
  const int sides = StepsIn(std::min(reach, kSideways * way_m), 2.0 * options_.step_m);
  const double turn = options_.step_deg * M_PI / 180.0;
  const int turns =
      StepsIn(std::min(kSigmas * turn_sigma, options_.range_deg * M_PI / 180.0), turn);
  for (int along = -steps; along <= steps; ++along) {
    for (int across = -sides; across <= sides; ++across) {
      for (int about = -turns; about <= turns; ++about) {
        const Eigen::Vector3d offset = options_.step_m * (along * way + 2.0 * across * side);
        hypotheses.emplace_back(centre.q * ExpSO3(turn * about * Eigen::Vector3d::UnitZ()),
                                centre.t + offset);
      }
    }
  }
  return hypotheses;
}

std::vector<MatchResult> PoseSearch::Refine(const std::vector<PointCluster>& clusters,
                                            const std::vector<SE3>& hypotheses, std::size_t most,
                                            const Wanted& wanted, const PosePrediction& prediction,
                                            const VoxelMap& map) const {
  const std::size_t stride =
      std::max<std::size_t>(1, clusters.size() / static_cast<std::size_t>(options_.clusters));
  std::vector<std::pair<double, std::size_t>> scores(hypotheses.size());
  ParallelChunks(hypotheses.size(), 16, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      scores[i] = {-matcher_->Score(clusters, hypotheses[i], map, options_.score_scale_m, stride),
                   i};
    }
  });
  std::sort(scores.begin(), scores.end());
  std::vector<SE3> starts;
  for (std::size_t k = 0; k < scores.size() && starts.size() < most; ++k) {
    if (wanted(hypotheses[scores[k].second])) starts.push_back(hypotheses[scores[k].second]);
  }
  std::vector<MatchResult> results(starts.size());
  ParallelChunks(starts.size(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      // Along what planes leave open, each hypothesis is its own prediction.
      results[i] = matcher_->MatchPose(clusters, {starts[i], prediction.covariance}, map);
    }
  });
  return results;
}

bool PoseSearch::ClearlyBetter(const std::vector<PointCluster>& clusters, const MatchResult& best,
                               const MatchResult& other, const VoxelMap& map) const {
  constexpr double kClearSigmas = 4.0, kClearShare = 0.01;
  const ScoreDifference difference = matcher_->Compare(
      clusters, best.T_world_lidar, other.T_world_lidar, map, options_.score_scale_m);
  return difference.mean > std::max(kClearShare, kClearSigmas * difference.sigma);
}

bool PoseSearch::Beats(const std::vector<PointCluster>& clusters, const MatchResult& r,
                       const MatchResult& best, const VoxelMap& map) const {
  if (r.status == MatchResult::Status::kTooFewMatches) return false;
  if (best.status == MatchResult::Status::kTooFewMatches) return true;
  // What meets hardly any plane speaks neither for its pose nor against it.
  constexpr double kLeastOverlap = 0.1;
  if (r.overlap() < kLeastOverlap) return false;
  if (best.overlap() < kLeastOverlap) return true;
  if (r.evidence() <= best.evidence()) return false;
  if (!Apart(r.T_world_lidar, best.T_world_lidar)) return true;
  // Where one place is as good as another, along a corridor, the one met first stays: that of the
  // prediction. A place that planes hold is better than one that the prediction holds.
  const bool held_by_planes = best.degenerate > 0 && r.worst_sigma_m < 0.5 * best.worst_sigma_m;
  return held_by_planes || ClearlyBetter(clusters, r, best, map);
}

MatchResult PoseSearch::Best(const std::vector<PointCluster>& clusters,
                             const std::vector<SE3>& hypotheses, const MatchResult& given,
                             const PosePrediction& prediction, const VoxelMap& map) const {
  const auto most = static_cast<std::size_t>(options_.refined);
  MatchResult best = given;
  for (const MatchResult& r : Refine(
           clusters, hypotheses, most, [](const SE3&) { return true; }, prediction, map)) {
    if (Beats(clusters, r, best, map)) best = r;
  }
  // From afar a weak direction takes more steps than from a good prediction.
  constexpr int kMoreRounds = 4;
  for (int i = 0; i < kMoreRounds && best.status == MatchResult::Status::kIterationLimit; ++i) {
    best = matcher_->MatchPose(clusters, {best.T_world_lidar, prediction.covariance}, map);
  }
  return best;
}

bool PoseSearch::Unique(const std::vector<PointCluster>& clusters,
                        const std::vector<SE3>& hypotheses, const MatchResult& best,
                        const PosePrediction& prediction, const VoxelMap& map) const {
  constexpr std::size_t kRivals = 6;
  const auto apart = [&](const SE3& T) { return Apart(T, best.T_world_lidar); };
  for (const MatchResult& r : Refine(clusters, hypotheses, kRivals, apart, prediction, map)) {
    if (r.status != MatchResult::Status::kTooFewMatches && apart(r.T_world_lidar) &&
        !ClearlyBetter(clusters, best, r, map))
      return false;
  }
  return true;
}

}  // namespace lamina
