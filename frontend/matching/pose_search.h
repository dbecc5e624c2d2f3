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
#include "frontend/matching/pose_hypotheses.h"
#include "frontend/matching/pose_search_options.h"
#include "frontend/matching/scan_matcher.h"

namespace lamina {

// A scan that is searched for, and the map. Refers to its parts.
struct SearchedScan {
  const std::vector<PointCluster>& clusters;
  const PosePrediction& prediction;
  const VoxelMap& map;
  // The map is young, and the sensor may never have moved in it: places are compared by votes
  // (FitDifference), which the errors of its beams do not sway.
  bool starting = false;
  // Earlier evidence leads to the same place: a smaller margin over others suffices.
  bool agreed = false;
  // Its points have times: distortion by the motion between them may make it fit badly.
  bool timed = false;
};

// Stateless; thread-safe while the map is only read. Same bits at any number of threads.
class PoseSearch {
 public:
  PoseSearch(const PoseSearchOptions& options, const ScanMatcher& matcher)
      : options_(options), matcher_(matcher), coarse_matcher_(Coarse(matcher.options())) {}

  // The best of the matches from the hypotheses and the given one, without a covariance. Brings the
  // coarse hypotheses to the minima near them first.
  MatchResult Best(const SearchedScan& scan, PoseHypotheses* hypotheses,
                   const MatchResult& given) const;
  // Whether no other place that the hypotheses lead to fits about as well, and the match is turned
  // no farther than they reach: after seconds of motion in a hand a descent may match one half of a
  // room to the other, and no hypothesis would show it.
  bool Unique(const SearchedScan& scan, const PoseHypotheses& hypotheses,
              const MatchResult& best) const;
  // Another place that explains what the scan meets about as well as the match does, of those that
  // the hypotheses, at minima, lead to, and of all headings that the prediction leaves open:
  // tangent from the match to the likeliest; zero if the match is told from all of them. Each block
  // of space has one vote (ScanMatcher::CompareBlocks, z), and each place costs what its distance
  // from the prediction does, s standard deviations, U = 2 log(1 + s^2). A match is told from a
  // rival, z' and U', if z |z| + U' - U > 2^2. Unlike in Unique, meeting more of the map is no
  // evidence: it occurs where the sensor has been before, in all that repeats, and beside objects
  // that move along.
  Vector6d Elsewhere(const SearchedScan& scan, const PoseHypotheses& hypotheses,
                     const MatchResult& best) const;
  // Brings the coarse hypotheses to the minima near them.
  void Descend(const SearchedScan& scan, PoseHypotheses* hypotheses) const;

 private:
  // Every how many-th cluster is scored.
  std::size_t Stride(std::size_t clusters) const;
  // Options for coarse hypotheses: a wide kernel throughout, and few steps.
  static ScanMatcherOptions Coarse(ScanMatcherOptions options);
  // Other headings, at minima, if the prediction leaves them open.
  PoseHypotheses Turned(const SearchedScan& scan) const;
  // Every Stride-th cluster.
  std::vector<PointCluster> Part(const std::vector<PointCluster>& clusters) const;
  // The `most` best of the dense and of the coarse hypotheses each, of those that are wanted and
  // apart from one another.
  using Wanted = std::function<bool(const SE3&)>;
  std::vector<SE3> Starts(const SearchedScan& scan, const PoseHypotheses& hypotheses,
                          std::size_t most, const Wanted& wanted) const;
  // The starts whose descent with a part of the clusters ends elsewhere than that of the given
  // match, moved to where it ends: a search that confirms a match costs no more than matching that
  // part. At a start all of them, since minima lie close together there.
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
  ScanMatcher matcher_, coarse_matcher_;
};

}  // namespace lamina
