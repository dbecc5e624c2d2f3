// The start of a sensor whose single scans make few planes: beams determine its motion.
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include "frontend/start/beam_agreement.h"
#include "frontend/start/resting_beams.h"
#include "frontend/start/start_track.h"

namespace lamina {
namespace {

// The beams of a scan, deskewed.
BeamAgreement BeamsOf(const std::vector<PointCluster>& clusters, double noise_m) {
  return {clusters, kRangeSigmas * noise_m};
}

// Two consecutive scans, deskewed by the motion of given poses.
struct BeamPair {
  BeamAgreement before;
  std::vector<PointCluster> clusters;
  SE3 T_before_this;
};

std::vector<BeamPair> BeamPairs(const StartScans& scans, const std::vector<SE3>& poses,
                                double noise_m) {
  std::vector<BeamPair> pairs;
  std::vector<PointCluster> before = scans.Deskewed(0, poses);
  for (std::size_t k = 1; k < poses.size(); ++k) {
    std::vector<PointCluster> clusters = scans.Deskewed(k, poses);
    pairs.push_back({BeamsOf(before, noise_m), clusters, poses[k - 1].Inverse() * poses[k]});
    before = std::move(clusters);
  }
  return pairs;
}

// Mean of A (beam_agreement.h) over the pairs, the later scan shifted by `aside` in the frame of
// the earlier one.
double Agreement(const std::vector<BeamPair>& pairs,
                 const Eigen::Vector3d& aside = Eigen::Vector3d::Zero()) {
  double sum = 0.0;
  for (const BeamPair& pair : pairs) {
    SE3 T = pair.T_before_this;
    T.t += aside;
    sum += pair.before.Of(pair.clusters, T);
  }
  return sum / static_cast<double>(pairs.size());
}

// Whether agreement drops to every side, so that beams determine the position. On the ground and
// walls along the way alone it does not.
bool BeamsTell(const std::vector<BeamPair>& pairs, double agreement) {
  // So far aside agreement is 0.1 of its maximum among trees, 0.5 to 0.7 along streets. Trunks and
  // walls constrain the height less, 0.4, but few sensors leave the ground.
  constexpr double kAsideM = 0.3, kMostAcross = 0.3, kMostUp = 0.6;
  constexpr int kDirections = 8;
  for (int i = 0; i < kDirections; ++i) {
    const double azimuth = 2.0 * M_PI * i / kDirections;
    const Eigen::Vector3d aside(kAsideM * std::cos(azimuth), kAsideM * std::sin(azimuth), 0.0);
    if (Agreement(pairs, aside) > kMostAcross * agreement) return false;
  }
  const Eigen::Vector3d up(0.0, 0.0, kAsideM);
  return Agreement(pairs, up) <= kMostUp * agreement &&
         Agreement(pairs, -up) <= kMostUp * agreement;
}

// Poses of the scans, each where its beams agree best with those of the scan before.
std::vector<SE3> PosesByBeams(const StartScans& scans, double noise_m) {
  const std::vector<SE3> own = scans.OwnPoses();
  std::vector<SE3> poses = {own.front()};
  Vector6d twist = Vector6d::Zero();
  for (std::size_t k = 1; k < scans.size(); ++k) {
    const double gap_s = scans.GapS(k);
    double most = -1.0;
    Vector6d best = twist;
    BeamAgreement before = BeamsOf(DeskewClusters(scans[k - 1].clusters, twist), noise_m);
    const auto climb = [&](const Vector6d& from) {
      // The first scan is deskewed by the motion to the second.
      if (k == 1) before = BeamsOf(DeskewClusters(scans[0].clusters, from), noise_m);
      const std::vector<PointCluster> clusters = DeskewClusters(scans[k].clusters, from);
      const SE3 T = before.Climb(clusters, TwistExp(gap_s * from));
      const double agreement = before.Of(clusters, T);
      if (agreement <= most) return;
      most = agreement;
      best = TwistLog(T) / gap_s;
    };
    climb(twist);
    if (k > 1) climb(Vector6d::Zero());
    climb(scans.Twist(own, k));
    if (AnyTimed(scans[k].clusters)) climb(Vector6d(best));
    twist = best;
    poses.push_back(poses.back() * TwistExp(gap_s * twist));
  }
  return poses;
}

}  // namespace

bool StartTrack::ToldByBeams(const MatchResult& second) const {
  // Share of the rays that lie beside those before: 0.03 for a Mid-360 among trees and in streets,
  // 0.4 and more for 16 rings and for an Avia, 0.16 for 2000 rays of a sensor that begins anywhere
  // in its first step.
  constexpr double kSparse = 0.3, kRepeated = 0.1;
  if (second.overlap() >= kSparse) return false;
  return BeamsOf(Undeskewed(scans_[0].clusters), steady_.noise_m)
             .Beside(Undeskewed(scans_[1].clusters), SE3()) < kRepeated;
}

bool StartTrack::BeamsContradict(const std::vector<SE3>& poses) const {
  constexpr std::size_t kLeastPairs = 3;
  if (!Stands(poses)) return false;
  RaysSeenAgain rays(steady_.noise_m);
  // A sensor that sets off has moved by the second half of the scans.
  for (std::size_t k = poses.size() / 2; k < poses.size(); ++k)
    rays.Add(Undeskewed(scans_[k - 1].clusters), Undeskewed(scans_[k].clusters),
             poses[k - 1].Inverse() * poses[k]);
  return rays.pairs() >= kLeastPairs && rays.Contradict();
}

bool StartTrack::SettleAll(std::vector<SE3>* poses, MatchResult* match) const {
  // Standard deviation of a pose by beams.
  constexpr double kOpenM = 0.1;
  constexpr int kMostRounds = 5;
  constexpr double kSettledM = 0.01;
  PosePrediction prediction;
  prediction.covariance.diagonal().setConstant(kOpenM * kOpenM);
  for (int round = 0; round < kMostRounds; ++round) {
    const std::vector<SE3> before = *poses;
    for (std::size_t k = 0; k < poses->size(); ++k) {
      const VoxelMap map = scans_.MapOf(*poses, poses->size(), k);
      prediction.T_world_lidar = (*poses)[k];
      *match = matcher_.Match(scans_.Deskewed(k, *poses), prediction, map);
      if (match->status == MatchResult::Status::kTooFewMatches) return false;
      (*poses)[k] = match->T_world_lidar;
    }
    if (Apart(before, *poses) < kSettledM) break;
  }
  return true;
}

bool StartTrack::TakeByBeams() {
  // Agreement by chance is 0.1 to 0.2. Right trajectories agree alike, within a tenth; one that is
  // biased in some of its scans agrees less, and so does the result of settling on it.
  constexpr double kLeastAgreement = 0.3, kRefuted = 0.85, kKept = 0.8;
  const double noise_m = steady_.noise_m;
  std::vector<SE3> poses = PosesByBeams(scans_, noise_m);
  const std::vector<BeamPair> pairs = BeamPairs(scans_, poses, noise_m);
  const double found = Agreement(pairs);
  const double own = Agreement(BeamPairs(scans_, scans_.OwnPoses(), noise_m));
  if (found < kLeastAgreement || own >= kRefuted * found || !BeamsTell(pairs, found)) return false;
  MatchResult match;
  if (!SettleAll(&poses, &match)) return false;
  const double settled = Agreement(BeamPairs(scans_, poses, noise_m));
  if (settled < kKept * found || own >= kRefuted * settled || Leaps(poses)) return false;
  Overrule(poses, poses, match);
  state_ = State::kToldByAll;
  // The match is to planes of all scans, in which lines of two scans do not coincide: nothing is
  // held.
  match_.degenerate_directions.setZero();
  match_.degenerate_information.setZero();
  return true;
}

}  // namespace lamina
