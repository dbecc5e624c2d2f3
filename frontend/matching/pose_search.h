// Search for a scan's pose over hypotheses about the prediction, for what matching alone cannot
// bridge: quick turns, gaps, a start at speed, a finished map.
//
// Hypotheses are scored on the map's planes, a hash look-up for each cluster, and the best are
// refined by matching. The winner must beat every other place that was found: hypotheses well apart
// from it are refined, too, and compared with it cluster by cluster.
#pragma once

#include <cstddef>
#include <functional>
#include <vector>

#include "core/geometry/point_cluster.h"
#include "core/geometry/se3.h"
#include "core/map/voxel_map.h"
#include "core/options/options.h"
#include "frontend/matching/scan_matcher.h"

namespace lamina {

struct PoseSearchOptions {
  bool enabled = true;
  // Started when match and prediction differ by more than this, or ...
  double trigger_rotation_deg = 2.0;
  double trigger_translation_m = 0.5;
  // ... the share of inliers is below this part of its recent median.
  double trigger_inlier_ratio = 0.7;
  // Turns: -range, ..., -step, 0, step, ..., range about each axis.
  double range_deg = 15.0;
  double step_deg = 5.0;
  // Clusters scored for each hypothesis, at most, and the scale of the score.
  int clusters = 400;
  double score_scale_m = 0.2;
  // Hypotheses refined by matching.
  int refined = 6;
  // While no speed is known: offsets along x and y of the sensor, -range, ..., range.
  double range_m = 3.0;
  double step_m = 0.5;
  // After a gap: offsets along the way, as far as the prediction is uncertain, but no farther.
  double max_way_m = 50.0;

  void Visit(OptionVisitor& v);
};

// What is searched for, and where. Refers to its parts.
struct SearchedScan {
  const std::vector<PointCluster>& clusters;
  const PosePrediction& prediction;
  const VoxelMap& map;
  // The map is young, and the sensor may never have moved in it: places are compared by votes
  // (FitDifference), which the errors of its beams do not sway.
  bool starting = false;
  // By how many standard deviations a match must be better than each rival.
  double clear_sigmas = 4.0;
  // The same at a start: two scans know less of a place than a map, and minima beside the right one
  // are nearly as good.
  static constexpr double kStartSigmas = 2.0;
};

struct PoseHypotheses {
  // As dense as matching reaches: the best by score are refined.
  std::vector<SE3> dense;
  // Too far apart for a score to tell which are near a minimum: PoseSearch::Descend brings each to
  // one first, on a part of the clusters.
  std::vector<SE3> coarse;
  // Direction in which they are spread, a unit vector in the world.
  Eigen::Vector3d way = Eigen::Vector3d::Zero();

  bool empty() const { return dense.empty() && coarse.empty(); }
};

// Stateless; thread-safe while the map is only read. Same bits at any number of threads.
class PoseSearch {
 public:
  // The matcher must outlive it.
  PoseSearch(const PoseSearchOptions& options, const ScanMatcher* matcher)
      : options_(options), matcher_(matcher), coarse_matcher_(Coarse(matcher->options())) {}

  // Turns of the sensor about each of these poses.
  std::vector<SE3> TurnsAbout(const std::vector<SE3>& centres) const;
  // Turns about the sensor's z axis, all round, at each of these poses and some way beside them.
  // Coarse.
  std::vector<SE3> AllRound(const std::vector<SE3>& centres) const;
  // Offsets along x and y of the sensor.
  std::vector<SE3> OffsetsAbout(const SE3& centre) const;
  // Offsets to all sides, as far as the prediction is uncertain where that is beyond what
  // OffsetsAbout covers. Coarse.
  std::vector<SE3> OffsetsAround(const PosePrediction& prediction) const;
  // Offsets along the way (unit vector, world), to either side of it and turned about the sensor's
  // z axis, as far as the prediction is uncertain; `way_m` is the way predicted since the last
  // pose. Coarse; empty where matching reaches as far itself.
  std::vector<SE3> AlongTheWay(const PosePrediction& prediction, const Eigen::Vector3d& way,
                               double way_m) const;

  // What to look at where no motion is known yet, and where the prediction goes on with one: as far
  // as it leaves open, along the way no farther than max_way_m.
  PoseHypotheses Starting(const PosePrediction& prediction, const SE3& T_world_last) const;
  PoseHypotheses GoingOn(const PosePrediction& prediction, const SE3& T_world_last) const;

  // Brings the coarse hypotheses to the minima near them, before they are searched.
  void Descend(const SearchedScan& scan, PoseHypotheses* hypotheses) const;
  // The best of the matches from the hypotheses and the given one, without a covariance.
  MatchResult Best(const SearchedScan& scan, const PoseHypotheses& hypotheses,
                   const MatchResult& given) const;
  // Whether no other place that the hypotheses lead to fits about as well, and the match is turned
  // no farther than they reach: after seconds in a hand a descent may turn a room's half into the
  // other one, and no hypothesis would show it.
  bool Unique(const SearchedScan& scan, const PoseHypotheses& hypotheses,
              const MatchResult& best) const;

 private:
  // Every how many-th cluster is scored.
  std::size_t Stride(std::size_t clusters) const;
  // For Descend: a wide kernel throughout, and few steps.
  static ScanMatcherOptions Coarse(ScanMatcherOptions options);
  // Every Stride-th cluster.
  std::vector<PointCluster> Part(const std::vector<PointCluster>& clusters) const;
  // The `most` best of the dense and of the coarse hypotheses each, of those that are wanted and
  // apart from one another.
  using Wanted = std::function<bool(const SE3&)>;
  std::vector<SE3> Starts(const SearchedScan& scan, const PoseHypotheses& hypotheses,
                          std::size_t most, const Wanted& wanted) const;
  // Those of the starts from which a part of the clusters does not lead to where it leads from the
  // match that is given, brought on as far as the part goes: a search that confirms a match costs
  // no more than matching that part. At a start all of them: minima lie close together there.
  std::vector<SE3> LeadElsewhere(const SearchedScan& scan, std::vector<SE3> starts,
                                 const MatchResult& given) const;
  // Without covariances. Along what planes leave open, each start is its own prediction.
  std::vector<MatchResult> MatchFrom(const SearchedScan& scan,
                                     const std::vector<PointCluster>& clusters,
                                     const std::vector<SE3>& starts) const;
  // The best match from starts beside this one along the way: there a street has minima in rows.
  MatchResult BestBeside(const SearchedScan& scan, const Eigen::Vector3d& way,
                         const MatchResult& match) const;
  struct Scored {
    double score = 0.0;
    SE3 T_world_lidar;
  };
  // The best first.
  void SortByScore(const SearchedScan& scan, std::size_t stride, double chance,
                   std::vector<Scored>* hypotheses) const;
  // The `most` best of the hypotheses that are wanted, by Score, and apart from one another by that
  // share of what is another place.
  std::vector<SE3> Promising(const SearchedScan& scan, const std::vector<SE3>& hypotheses,
                             double chance, double apart, std::size_t most,
                             const Wanted& wanted) const;
  // Whether r takes the place of the best match so far.
  bool Beats(const SearchedScan& scan, const MatchResult& r, const MatchResult& best) const;
  bool Better(double sigmas, const SearchedScan& scan, const MatchResult& ours,
              const MatchResult& theirs) const;

  PoseSearchOptions options_;
  const ScanMatcher* matcher_;
  ScanMatcher coarse_matcher_;
};

}  // namespace lamina
