#include "frontend/matching/pose_search.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>

#include "core/base/angle.h"
#include "core/base/median.h"
#include "core/base/parallel.h"
#include "core/base/thinning.h"
#include "core/geometry/robust_kernel.h"

namespace lamina {
namespace {

// Poses that are another place, not another start into the same minimum.
constexpr double kApartM = 0.75, kApartRad = 0.07;
bool Apart(const SE3& a, const SE3& b, double share = 1.0) {
  return (a.t - b.t).norm() > share * kApartM || RotationAngle(a, b) > share * kApartRad;
}

// Angle by which a descent turns a pose at most, as a rule.
constexpr double kDescentRad = Radians(15.0);

// Whether a pose is farther from all turns that were tried than descents turn: no search was made
// around it. False if no turns were tried, as about a start that is given without a heading.
bool TurnedAway(const std::vector<SE3>& dense, const SE3& T_world_lidar) {
  const auto away = [&](const SE3& T) { return RotationAngle(T, T_world_lidar) > kDescentRad; };
  const bool turned = !dense.empty() && RotationAngle(dense.front(), dense.back()) > kDescentRad;
  return turned && std::all_of(dense.begin(), dense.end(), away);
}

// Whether a quarter turn is within what a prediction leaves open.
bool MayHaveTurnedAbout(const PosePrediction& prediction) {
  constexpr double kLikelySigmas = 3.0;
  return kLikelySigmas * SigmaRad(prediction) > 0.5 * M_PI;
}

// Share of the distance of another place at which two poses are different minima.
constexpr double kMinimaApart = 0.3;

// U (CauchyCost) of a pose by its prediction.
double Unlikeliness(const PosePrediction& prediction, const SE3& T_world_lidar) {
  const Vector6d delta = LocalDelta(prediction.T_world_lidar, T_world_lidar);
  return CauchyCost(delta.dot(prediction.covariance.ldlt().solve(delta)));
}

// Half-way between the 5 % and the 95 % quantile of the values.
double Middle(std::vector<double> values) {
  constexpr double kOutside = 0.05;
  return 0.5 * (Quantile(&values, kOutside) + Quantile(&values, 1.0 - kOutside));
}

// A pose turned by quarters about the sensor's z axis through the middle of what it sees: a
// rectangular room, or court, coincides with itself.
std::vector<SE3> TurnedByQuarters(const std::vector<PointCluster>& clusters, const SE3& T) {
  std::vector<SE3> turned;
  if (clusters.empty()) return turned;
  std::vector<double> x, y;
  for (const PointCluster& cluster : clusters) {
    x.push_back(cluster.mean.x());
    y.push_back(cluster.mean.y());
  }
  const Eigen::Vector3d middle(Middle(std::move(x)), Middle(std::move(y)), 0.0);
  for (int quarters = 1; quarters < 4; ++quarters) {
    const Eigen::Quaterniond q = ExpSO3(0.5 * M_PI * quarters * Eigen::Vector3d::UnitZ());
    turned.emplace_back(T.q * q, T * (middle - q * middle));
  }
  return turned;
}

constexpr double kCompareScale = 1.5;  // of the score's scale

}  // namespace

ScanMatcherOptions PoseSearch::Coarse(ScanMatcherOptions options) {
  constexpr double kWide = 5.0;
  options.kernel_start_sigma *= kWide;
  options.kernel_end_sigma *= kWide;
  options.max_iterations = 8;
  options.max_distance_m *= 1.5;
  return WithinRange(options);
}

std::size_t PoseSearch::Stride(std::size_t clusters) const {
  return StrideToAtLeast(clusters, static_cast<std::size_t>(options_.clusters));
}

void PoseSearch::SortByScore(const SearchedScan& scan, std::size_t stride, double chance,
                             std::vector<Scored>* hypotheses) const {
  ParallelChunks(hypotheses->size(), 16, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      (*hypotheses)[i].score = matcher_.Score(scan.clusters, (*hypotheses)[i].T_world_lidar,
                                              scan.map, options_.score_scale_m, stride, chance);
    }
  });
  std::stable_sort(hypotheses->begin(), hypotheses->end(),
                   [](const Scored& a, const Scored& b) { return a.score > b.score; });
}

std::vector<SE3> PoseSearch::Promising(const SearchedScan& scan, const std::vector<SE3>& hypotheses,
                                       double chance, double apart, std::size_t most,
                                       const Wanted& wanted) const {
  const std::size_t stride = Stride(scan.clusters.size());
  std::vector<Scored> scores;
  for (const SE3& T : hypotheses) scores.push_back({0.0, T});
  // A quarter of the clusters tells which hypotheses are hopeless.
  constexpr std::size_t kCoarser = 4, kLeft = 6, kFew = 100;
  if (scores.size() > 2 * kFew && scan.clusters.size() >= kCoarser * stride * kFew) {
    SortByScore(scan, kCoarser * stride, chance, &scores);
    scores.resize(std::max(kFew, scores.size() / kLeft));
  }
  SortByScore(scan, stride, chance, &scores);
  // A pose that fits far worse before matching hardly ever fits best after it, except in a young
  // map.
  constexpr double kLeastShare = 0.8;
  const double least = scan.starting || scores.empty() ? -1.0 : kLeastShare * scores[0].score;
  std::vector<SE3> best;
  for (std::size_t k = 0; k < scores.size() && best.size() < most && scores[k].score >= least;
       ++k) {
    const SE3& T = scores[k].T_world_lidar;
    const bool known = std::any_of(best.begin(), best.end(),
                                   [&](const SE3& other) { return !Apart(T, other, apart); });
    if (!known && wanted(T)) best.push_back(T);
  }
  return best;
}

std::vector<PointCluster> PoseSearch::Part(const std::vector<PointCluster>& clusters) const {
  std::vector<PointCluster> part;
  for (std::size_t i = 0; i < clusters.size(); i += Stride(clusters.size()))
    part.push_back(clusters[i]);
  return part;
}

void PoseSearch::Descend(const SearchedScan& scan, PoseHypotheses* hypotheses) const {
  if (hypotheses->coarse.empty()) return;
  const std::vector<PointCluster> part = Part(scan.clusters);
  std::vector<SE3>& poses = hypotheses->coarse;
  ParallelChunks(poses.size(), 4, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      poses[i] = coarse_matcher_.MatchPose(part, {poses[i], scan.prediction.covariance}, scan.map)
                     .T_world_lidar;
    }
  });
}

std::vector<SE3> PoseSearch::Starts(const SearchedScan& scan, const PoseHypotheses& hypotheses,
                                    std::size_t most, const Wanted& wanted) const {
  std::vector<SE3> starts = Promising(scan, hypotheses.dense, 0.0, 1.0, most, wanted);
  // At a minimum the fit decides, however much of the scan meets planes at all.
  const std::vector<SE3> minima =
      Promising(scan, hypotheses.coarse, MatchResult::kChanceFit, kMinimaApart, most, wanted);
  starts.insert(starts.end(), minima.begin(), minima.end());
  return starts;
}

std::vector<MatchResult> PoseSearch::MatchFrom(const SearchedScan& scan,
                                               const std::vector<PointCluster>& clusters,
                                               const std::vector<SE3>& starts) const {
  std::vector<MatchResult> results(starts.size());
  ParallelChunks(starts.size(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i)
      results[i] = matcher_.MatchPose(clusters, {starts[i], scan.prediction.covariance}, scan.map);
  });
  return results;
}

std::vector<SE3> PoseSearch::LeadElsewhere(const SearchedScan& scan, std::vector<SE3> starts,
                                           const MatchResult& given) const {
  if (scan.starting || given.status == MatchResult::Status::kTooFewMatches) return starts;
  starts.push_back(given.T_world_lidar);
  const std::vector<MatchResult> ends = MatchFrom(scan, Part(scan.clusters), starts);
  const MatchResult& known = ends.back();
  constexpr double kBetter = 0.003;
  std::vector<SE3> elsewhere;
  // A narrow minimum may exist for all clusters together only: a part of them leads out of it.
  if (known.status != MatchResult::Status::kTooFewMatches &&
      Apart(known.T_world_lidar, given.T_world_lidar, kMinimaApart))
    elsewhere.push_back(known.T_world_lidar);
  for (std::size_t i = 0; i + 1 < ends.size(); ++i) {
    const MatchResult& end = ends[i];
    if (end.status != MatchResult::Status::kTooFewMatches &&
        (Apart(end.T_world_lidar, known.T_world_lidar) ||
         end.evidence() > known.evidence() + kBetter))
      elsewhere.push_back(end.T_world_lidar);
  }
  return elsewhere;
}

bool PoseSearch::Better(double sigmas, const SearchedScan& scan, const MatchResult& ours,
                        const MatchResult& theirs) const {
  const FitDifference difference =
      matcher_.Compare(scan.clusters, ours.T_world_lidar, theirs.T_world_lidar, scan.map,
                       kCompareScale * options_.score_scale_m);
  if (scan.starting) return difference.votes_sigmas > sigmas;
  // Errors of neighbouring clusters are correlated, so that their sum must be significant by size,
  // too.
  constexpr double kLeastEvidence = 0.002;
  return difference.evidence_sigmas > sigmas && difference.evidence > kLeastEvidence;
}

bool PoseSearch::Beats(const SearchedScan& scan, const MatchResult& r,
                       const MatchResult& best) const {
  if (r.status == MatchResult::Status::kTooFewMatches) return false;
  if (best.status == MatchResult::Status::kTooFewMatches) return true;
  // A match that meets hardly any plane is evidence neither for its pose nor against it.
  constexpr double kLeastOverlap = 0.1;
  if (r.overlap() < kLeastOverlap) return false;
  if (best.overlap() < kLeastOverlap) return true;
  const bool says_more = r.evidence() > best.evidence();
  if (!Apart(r.T_world_lidar, best.T_world_lidar)) return says_more;
  // If one place is as good as another, as along a corridor, the one met first stays: that of the
  // prediction. A place that planes hold is better than one that the prediction holds.
  const bool held_by_planes = best.degenerate > 0 && r.worst_sigma_m < 0.5 * best.worst_sigma_m;
  if (held_by_planes && says_more) return true;
  // In a map of one scan, clusters that lie by chance on its few planes may be a majority of those
  // that make a difference, where all together say nothing.
  if (scan.starting && !says_more) return false;
  constexpr double kBetterSigmas = 1.5;
  return Better(kBetterSigmas, scan, r, best);
}

MatchResult PoseSearch::Best(const SearchedScan& scan, PoseHypotheses* hypotheses,
                             const MatchResult& given) const {
  Descend(scan, hypotheses);
  const std::vector<SE3> starts =
      Starts(scan, *hypotheses, static_cast<std::size_t>(options_.refined),
             [](const SE3&) { return true; });
  MatchResult best = given;
  for (const MatchResult& r : MatchFrom(scan, scan.clusters, LeadElsewhere(scan, starts, given))) {
    if (Beats(scan, r, best)) best = r;
  }
  if (!hypotheses->way.isZero()) best = BestBeside(scan, hypotheses->way, best);
  // Along a weak direction a distant start takes more steps than a good prediction.
  constexpr int kMoreRounds = 4;
  for (int i = 0; i < kMoreRounds && best.status == MatchResult::Status::kIterationLimit; ++i)
    best = MatchFrom(scan, scan.clusters, {best.T_world_lidar})[0];
  return best;
}

MatchResult PoseSearch::BestBeside(const SearchedScan& scan, const Eigen::Vector3d& way,
                                   const MatchResult& match) const {
  constexpr double kShortStepM = 0.25;
  constexpr int kSteps = 3;
  std::vector<SE3> beside;
  for (int i = -kSteps; i <= kSteps; ++i) {
    if (i != 0)
      beside.emplace_back(match.T_world_lidar.q, match.T_world_lidar.t + kShortStepM * i * way);
  }
  MatchResult best = match;
  for (const MatchResult& r : MatchFrom(scan, scan.clusters, LeadElsewhere(scan, beside, match))) {
    if (r.status != MatchResult::Status::kTooFewMatches && r.evidence() > best.evidence()) best = r;
  }
  return best;
}

bool PoseSearch::Unique(const SearchedScan& scan, const PoseHypotheses& hypotheses,
                        const MatchResult& best) const {
  if (TurnedAway(hypotheses.dense, best.T_world_lidar)) return false;
  constexpr std::size_t kRivals = 6;
  const auto apart = [&](const SE3& T) { return Apart(T, best.T_world_lidar); };
  std::vector<SE3> rivals = Starts(scan, hypotheses, kRivals, apart);
  // By how many standard deviations the match must be better than each rival. Two scans know less
  // of a place than a map, and minima beside the right one are nearly as good.
  constexpr double kClearSigmas = 4.0, kLessClearSigmas = 2.0;
  double clear_sigmas = scan.starting || scan.agreed ? kLessClearSigmas : kClearSigmas;
  if (RotationAngle(best.T_world_lidar, scan.prediction.T_world_lidar) > kDescentRad &&
      MayHaveTurnedAbout(scan.prediction)) {
    // In structure that repeats, following scans confirm a wrong place as well.
    clear_sigmas = kClearSigmas;
    const std::vector<SE3> turned = TurnedByQuarters(scan.clusters, best.T_world_lidar);
    rivals.insert(rivals.end(), turned.begin(), turned.end());
  }
  for (const MatchResult& r : MatchFrom(scan, scan.clusters, rivals)) {
    if (r.status != MatchResult::Status::kTooFewMatches && apart(r.T_world_lidar) &&
        !Better(clear_sigmas, scan, best, r))
      return false;
  }
  return true;
}

PoseHypotheses PoseSearch::Turned(const SearchedScan& scan) const {
  constexpr double kSigmas = 2.0;
  PoseHypotheses turned;
  if (kSigmas * SigmaRad(scan.prediction) <= kDescentRad) return turned;
  turned.dense = turned.coarse = AllRound({scan.prediction.T_world_lidar});
  Descend(scan, &turned);
  return turned;
}

Vector6d PoseSearch::Elsewhere(const SearchedScan& scan, const PoseHypotheses& hypotheses,
                               const MatchResult& best) const {
  constexpr std::size_t kRivals = 6;
  constexpr double kClearSigmas = 2.0;
  const auto apart = [&](const SE3& T) { return Apart(T, best.T_world_lidar); };
  // A map that the sensor has just begun is no measure of how well a place fits.
  SearchedScan young = scan;
  young.starting = true;
  PoseHypotheses all = Turned(young);
  std::vector<SE3> rivals;
  if (!all.dense.empty()) rivals = TurnedByQuarters(scan.clusters, best.T_world_lidar);
  all.dense.insert(all.dense.begin(), hypotheses.dense.begin(), hypotheses.dense.end());
  all.coarse.insert(all.coarse.begin(), hypotheses.coarse.begin(), hypotheses.coarse.end());
  const std::vector<SE3> others = Starts(young, all, kRivals, apart);
  rivals.insert(rivals.end(), others.begin(), others.end());
  const double own = Unlikeliness(scan.prediction, best.T_world_lidar);
  const auto clear_of = [&](const MatchResult& r) {
    if (r.status == MatchResult::Status::kTooFewMatches || !apart(r.T_world_lidar))
      return std::numeric_limits<double>::infinity();
    const double z = matcher_.CompareBlocks(scan.clusters, best.T_world_lidar, r.T_world_lidar,
                                            scan.map, kCompareScale * options_.score_scale_m);
    return ClearSquared(z, Unlikeliness(scan.prediction, r.T_world_lidar) - own);
  };
  double least = kClearSigmas * kClearSigmas;
  Vector6d elsewhere = Vector6d::Zero();
  // A part of the clusters rejects most rivals; from where its descent ends, all may lead on.
  for (const MatchResult& part : MatchFrom(scan, Part(scan.clusters), rivals)) {
    if (clear_of(part) >= least) continue;
    const MatchResult r = MatchFrom(scan, scan.clusters, {part.T_world_lidar})[0];
    const double clear = clear_of(r);
    if (clear >= least) continue;
    least = clear;
    elsewhere = LocalDelta(best.T_world_lidar, r.T_world_lidar);
  }
  return elsewhere;
}

}  // namespace lamina
