#include "frontend/start/steady_motion.h"

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <limits>
#include <numeric>
#include <utility>

#include "core/base/median.h"
#include "core/base/parallel.h"
#include "core/base/thinning.h"
#include "core/map/voxel_key.h"
#include "frontend/matching/block_votes.h"

namespace lamina {
namespace {

// n_0: points with which a block counts half.
constexpr double kHalfPoints = 20.0;

// Shifts of four grids, in voxels: no two grids share a face.
constexpr double kShifts[][3] = {
    {0.1, 0.2, 0.3}, {0.6, 0.7, 0.8}, {0.35, 0.95, 0.05}, {0.85, 0.45, 0.55}};
constexpr std::size_t kGrids = std::size(kShifts);
// Grids sufficient to tell well-separated speeds apart.
constexpr std::size_t kCoarseGrids = 2;
// Two motions are indistinguishable below this many standard deviations.
constexpr double kOpenSigmas = 2.0;

double Votes(const std::vector<double>& one, const std::vector<double>& other) {
  BlockVotes votes;
  for (std::size_t b = 0; b < one.size(); ++b) votes.Add(one[b] - other[b]);
  return votes.Sigmas();
}

}  // namespace

SteadyMotionSearch::SteadyMotionSearch(const SteadyMotionOptions& options, const Eigen::Vector3d& u,
                                       const Eigen::Vector3d& axis, std::vector<SteadyScan> scans)
    : options_(options), u_(u), scans_(std::move(scans)) {
  ThinOut();
  MakeGrids(axis);
  VoxelIndex blocks(256);
  for (const SteadyScan& scan : scans_) {
    for (const PointCluster& cluster : scan.clusters) {
      const std::int32_t block = blocks.FindOrInsert(
          BlockAround(cluster.mean), static_cast<std::int32_t>(block_points_.size()));
      block_of_.push_back(block);
      if (static_cast<std::size_t>(block) == block_points_.size()) block_points_.push_back(0.0);
      block_points_[static_cast<std::size_t>(block)] += cluster.count;
    }
  }
  for (const SteadyMotionGrid& grid : grids_) blocks_.push_back(grid.InOrder(block_of_));
  duration_s_ = std::max(1e-3, scans_.back().time_s - scans_.front().time_s);
  middle_s_ = 0.5 * (scans_.front().time_s + scans_.back().time_s);
  // Step of the search: the maximum of L is as wide as the speeds that shift the last scan by a
  // voxel.
  constexpr double kStepVoxels = 0.44;
  step_m_s_ = kStepVoxels * options_.voxel_size_m / duration_s_;
  // Scans that are farther apart than their range have no surface in common.
  std::vector<double> ranges_m;
  for (const PointCluster& cluster : scans_.front().clusters)
    ranges_m.push_back((cluster.mean - scans_.front().centre).norm());
  if (!ranges_m.empty())
    max_speed_m_s_ = std::min(options_.max_speed_m_s, 2.0 * UpperMedian(&ranges_m) / duration_s_);
  if (RaysRepeat()) few_ = Sparse::kTellNothing;
}

void SteadyMotionSearch::ThinOut() {
  // So many clusters determine a speed in any scene, and hundreds of speeds are tried.
  constexpr std::size_t kMostClusters = 3000;
  for (SteadyScan& scan : scans_) {
    const std::size_t stride = StrideToAtMost(scan.clusters.size(), kMostClusters);
    if (stride == 1) continue;
    std::size_t kept = 0;
    for (std::size_t i = 0; i < scan.clusters.size(); i += stride, ++kept) {
      scan.clusters[kept] = scan.clusters[i];
      if (!scan.cluster_times_s.empty()) scan.cluster_times_s[kept] = scan.cluster_times_s[i];
    }
    scan.clusters.resize(kept);
    if (!scan.cluster_times_s.empty()) scan.cluster_times_s.resize(kept);
  }
}

void SteadyMotionSearch::MakeGrids(const Eigen::Vector3d& axis) {
  const std::vector<char> is_in_space = ChooseViews(axis);
  // If u is the axis, all is judged in 3D, and the direction across is arbitrary.
  constexpr double kAboutAxis = 0.01;
  const Eigen::Vector3d across = axis.cross(u_);
  SteadyMotionAxes axes;
  axes.along = u_;
  axes.across = across.norm() > kAboutAxis ? across.normalized() : u_.unitOrthogonal();
  axes.up = axes.along.cross(axes.across);
  grids_.reserve(kGrids);
  const std::vector<SteadyMotionGrid::TurnedCluster> clusters =
      SteadyMotionGrid::Turn(axes, scans_);
  for (const double* shift : kShifts) {
    grids_.emplace_back(options_.voxel_size_m, options_.noise_m, clusters, is_in_space,
                        Eigen::Vector3d(shift));
  }
}

std::vector<char> SteadyMotionSearch::ChooseViews(const Eigen::Vector3d& axis) const {
  constexpr double kColumnM = 4.0, kGroundM = 0.3, kAlongAxis = 0.7;
  VoxelIndex columns(256);
  std::vector<double> lowest_m, heights_m;
  std::vector<std::int32_t> column_of;
  for (const SteadyScan& scan : scans_) {
    for (const PointCluster& cluster : scan.clusters) {
      heights_m.push_back(axis.dot(cluster.mean));
      const Eigen::Vector3d foot = cluster.mean - heights_m.back() * axis;
      const auto next = static_cast<std::int32_t>(lowest_m.size());
      column_of.push_back(columns.FindOrInsert(VoxelKeyOf(foot, 1.0 / kColumnM), next));
      if (column_of.back() == next) lowest_m.push_back(heights_m.back());
      double& lowest = lowest_m[static_cast<std::size_t>(column_of.back())];
      lowest = std::min(lowest, heights_m.back());
    }
  }
  const bool upwards = std::abs(axis.dot(u_)) > kAlongAxis;
  std::vector<char> in_space;
  for (std::size_t i = 0; i < heights_m.size(); ++i) {
    const double ground_m = lowest_m[static_cast<std::size_t>(column_of[i])] + kGroundM;
    in_space.push_back(upwards || heights_m[i] < ground_m ? 1 : 0);
  }
  return in_space;
}

WayAlong SteadyMotionSearch::WayUnder(const SteadyMotion& motion) const {
  const auto at = [&](double t) {
    return motion.speed_m_s * t + 0.5 * motion.acceleration_m_s2 * t * t;
  };
  WayAlong way;
  for (const SteadyScan& scan : scans_) {
    const double t = scan.time_s - middle_s_;
    way.positions_m.push_back(at(t) - at(scans_.front().time_s - middle_s_));
    way.speeds_m_s.push_back(motion.speed_m_s + motion.acceleration_m_s2 * t);
  }
  return way;
}

std::vector<double> SteadyMotionSearch::BlocksOf(const WayAlong& way, std::size_t grids,
                                                 Scratch* scratch) const {
  return BlocksIn(*this, way, grids, scratch);
}

std::vector<double> SteadyMotionSearch::BlocksIn(const SteadyMotionSearch& places,
                                                 const WayAlong& way, std::size_t grids,
                                                 Scratch* scratch) const {
  Evidence sums;
  AddGrids(places, way, 0, grids, Share::kAll, scratch, &sums);
  return places.Means(sums.blocks, grids);
}

void SteadyMotionSearch::AddGrids(const SteadyMotionSearch& places, const WayAlong& way,
                                  std::size_t begin, std::size_t end, Share share, Scratch* scratch,
                                  Evidence* sums) const {
  sums->blocks.resize(places.block_points_.size(), 0.0);
  for (std::size_t i = begin; i < end; ++i) {
    if (&places == this) {
      grids_[i].AddSharpness(way, blocks_[i], few_, share, scratch, sums);
    } else {
      grids_[i].AddSharpness(way, grids_[i].InOrder(places.block_of_), places.few_, share, scratch,
                             sums);
    }
  }
}

void SteadyMotionSearch::AddGrids(std::size_t begin, std::size_t end, Share share,
                                  std::vector<Candidate>* candidates) const {
  // So many candidates share scratch memory, which would otherwise be allocated anew each time.
  constexpr std::size_t kTogether = 8;
  ParallelChunks(candidates->size(), kTogether, [&](std::size_t first, std::size_t last) {
    Scratch scratch;
    for (std::size_t i = first; i < last; ++i) {
      Candidate& candidate = (*candidates)[i];
      AddGrids(*this, WayUnder(candidate.motion), begin, end, share, &scratch, &candidate.sums);
    }
  });
}

std::vector<double> SteadyMotionSearch::Means(const std::vector<double>& sums, std::size_t grids,
                                              const std::vector<double>& points) {
  std::vector<double> means(sums.size());
  for (std::size_t b = 0; b < sums.size(); ++b)
    means[b] = sums[b] / (static_cast<double>(grids) * (points[b] + kHalfPoints));
  return means;
}

double SteadyMotionSearch::Total(const SteadyMotion& motion,
                                 const std::vector<double>& blocks) const {
  const double v = motion.speed_m_s / options_.speed_sigma_m_s;
  const double a = motion.acceleration_m_s2 / options_.acceleration_sigma_m_s2;
  return std::accumulate(blocks.begin(), blocks.end(), -0.5 * (v * v + a * a));
}

FoundMotion SteadyMotionSearch::Climb(const SteadyMotion& start) const {
  constexpr double kLeastStepMS = 0.0125, kAccelerationStepPerS = 8.0;
  std::array<Scratch, 4> scratch;
  FoundMotion best;
  best.motion = start;
  best.blocks = BlocksOf(WayUnder(start), kGrids, scratch.data());
  double most = Total(start, best.blocks);
  constexpr std::size_t kNone = 4;
  std::size_t back = kNone;  // where it came from, which is worse
  for (double step = step_m_s_; step >= kLeastStepMS;) {
    const SteadyMotion from = best.motion;
    const double faster = kAccelerationStepPerS * step;
    const std::array<SteadyMotion, 4> beside = {{
        {from.speed_m_s + step, from.acceleration_m_s2},
        {from.speed_m_s - step, from.acceleration_m_s2},
        {from.speed_m_s, from.acceleration_m_s2 + faster},
        {from.speed_m_s, from.acceleration_m_s2 - faster},
    }};
    std::array<double, 4> evidence{};
    std::array<std::vector<double>, 4> blocks;
    ParallelChunks(beside.size(), 1, [&](std::size_t i, std::size_t) {
      evidence[i] = -std::numeric_limits<double>::infinity();
      if (i == back) return;
      blocks[i] = BlocksOf(WayUnder(beside[i]), kGrids, &scratch[i]);
      evidence[i] = Total(beside[i], blocks[i]);
    });
    const auto i = static_cast<std::size_t>(
        std::distance(evidence.begin(), std::max_element(evidence.begin(), evidence.end())));
    if (evidence[i] > most) {
      most = evidence[i];
      best.motion = beside[i];
      best.blocks = std::move(blocks[i]);
      back = i ^ 1U;
    } else {
      step *= 0.5;
      back = kNone;
    }
  }
  return best;
}

bool SteadyMotionSearch::RaysRepeat() const {
  // Points in sparse voxels if the sensor stands, relative to motion: 0.2 to 0.7 for 16 to 64
  // rings, 0.9 to 1.2 for rosettes.
  constexpr double kVoxelsAside = 5.0, kMuchLess = 0.8;
  const double aside_m_s = kVoxelsAside * options_.voxel_size_m / duration_s_;
  const SteadyMotion motions[] = {{}, {aside_m_s, 0.0}, {-aside_m_s, 0.0}};
  double sparse[std::size(motions)] = {};
  ParallelChunks(std::size(motions), 1, [&](std::size_t i, std::size_t) {
    Scratch scratch;
    for (std::size_t grid = 0; grid < kCoarseGrids; ++grid)
      sparse[i] += grids_[grid].SparsePoints(WayUnder(motions[i]), &scratch);
  });
  return sparse[0] < kMuchLess * std::min(sparse[1], sparse[2]);
}

std::vector<SteadyMotionSearch::Candidate> SteadyMotionSearch::Candidates() const {
  // Largest acceleration from rest, in standard deviations.
  constexpr double kMostFromRest = 1.5;
  std::vector<Candidate> candidates;
  const auto most_steps = static_cast<int>(max_speed_m_s_ / step_m_s_);
  for (int i = -most_steps; i <= most_steps; ++i) candidates.push_back({{step_m_s_ * i, 0.0}, {}});
  // A sensor that sets off ends at twice its mean speed.
  const double most_mean_m_s = 0.5 * kMostFromRest * options_.acceleration_sigma_m_s2 * duration_s_;
  const auto most_off = static_cast<int>(std::min(most_mean_m_s, max_speed_m_s_) / step_m_s_);
  for (int i = -most_off; i <= most_off; ++i)
    candidates.push_back({{step_m_s_ * i, 2.0 * step_m_s_ * i / duration_s_}, {}});
  return candidates;
}

std::size_t SteadyMotionSearch::Likeliest(std::size_t grids, const std::vector<double>& points,
                                          double refuted_sigmas,
                                          std::vector<Candidate>* candidates) const {
  // Scans mostly see the same surfaces: a speed at which they share much less than at others is
  // rejected, though nothing that they see contradicts it.
  constexpr double kLeastShared = 0.5;
  double most_shared = 0.0;
  for (const Candidate& c : *candidates) most_shared = std::max(most_shared, c.sums.shared);
  const auto is_none = [&](const Candidate& c) {
    return c.sums.shared < kLeastShared * most_shared;
  };
  candidates->erase(std::remove_if(candidates->begin(), candidates->end(), is_none),
                    candidates->end());
  std::size_t best = 0;
  double most = -std::numeric_limits<double>::infinity();
  std::vector<std::vector<double>> blocks;
  for (const Candidate& candidate : *candidates) {
    blocks.push_back(Means(candidate.sums.blocks, grids, points));
    const double total = Total(candidate.motion, blocks.back());
    if (total <= most) continue;
    best = blocks.size() - 1;
    most = total;
  }
  std::vector<Candidate> left;
  std::size_t best_left = 0;
  for (std::size_t i = 0; i < candidates->size(); ++i) {
    if (Votes(blocks[best], blocks[i]) >= refuted_sigmas) continue;
    if (i == best) best_left = left.size();
    left.push_back(std::move((*candidates)[i]));
  }
  *candidates = std::move(left);
  return best_left;
}

bool SteadyMotionSearch::Refutes(const WayAlong& way, const Candidate& candidate) const {
  Scratch scratch;
  return Votes(BlocksOf(way, 1, &scratch), Means(candidate.sums.blocks, 1)) > kOpenSigmas;
}

std::optional<FoundMotion> SteadyMotionSearch::FindUnless(const WayAlong* refuted_by) const {
  // Most candidates are refuted so clearly that a few columns of one grid suffice, or that grid.
  constexpr double kClearly = 2.0 * kOpenSigmas;
  std::vector<Candidate> candidates = Candidates();
  AddGrids(0, 1, Share::kFew, &candidates);
  Likeliest(1, grids_[0].PointsOf(Share::kFew, blocks_[0], block_points_.size()), kClearly,
            &candidates);
  AddGrids(0, 1, Share::kOthers, &candidates);
  const std::size_t likeliest = Likeliest(1, block_points_, kClearly, &candidates);
  if (refuted_by != nullptr && Refutes(*refuted_by, candidates[likeliest])) return std::nullopt;
  AddGrids(1, kCoarseGrids, Share::kAll, &candidates);
  const std::size_t best =
      Likeliest(kCoarseGrids, block_points_, std::numeric_limits<double>::infinity(), &candidates);
  FoundMotion found = Climb(candidates[best].motion);
  for (const Candidate& candidate : candidates)
    found.rivals.push_back({candidate.motion, Means(candidate.sums.blocks, kCoarseGrids)});
  return found;
}

double SteadyMotionSearch::OpenSpeed(const FoundMotion& found) const {
  // Speeds within so many steps of one another are told apart in all grids.
  constexpr int kNearSteps = 4;
  const SteadyMotion& motion = found.motion;
  Scratch scratch;
  const std::vector<double> ours_coarse = BlocksOf(WayUnder(motion), kCoarseGrids, &scratch);
  double open_m_s = 0.0;
  for (const FoundMotion::Rival& rival : found.rivals) {
    const double apart = std::abs(rival.motion.speed_m_s - motion.speed_m_s);
    if (apart > kNearSteps * step_m_s_ && Votes(ours_coarse, rival.blocks) < kOpenSigmas)
      open_m_s = std::max(open_m_s, apart);
  }
  for (int step = -kNearSteps; step <= kNearSteps; ++step) {
    const double apart = step_m_s_ * step;
    const SteadyMotion other = {motion.speed_m_s + apart, motion.acceleration_m_s2};
    if (step != 0 && Votes(found.blocks, BlocksOf(WayUnder(other), kGrids, &scratch)) < kOpenSigmas)
      open_m_s = std::max(open_m_s, std::abs(apart));
  }
  return open_m_s;
}

double SteadyMotionSearch::Sharper(const WayAlong& one, const WayAlong& other) const {
  return Sharper(one, *this, other);
}

double SteadyMotionSearch::Sharper(const FoundMotion& one, const WayAlong& other) const {
  Scratch scratch;
  return Votes(one.blocks, BlocksOf(other, kGrids, &scratch));
}

double SteadyMotionSearch::Sharper(const WayAlong& one, const SteadyMotionSearch& from,
                                   const WayAlong& other) const {
  Scratch scratch;
  return Votes(BlocksOf(one, kGrids, &scratch), from.BlocksIn(*this, other, kGrids, &scratch));
}

}  // namespace lamina
