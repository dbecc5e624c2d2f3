// One scan in, one pose out: predict, deskew, match, search, judge.
//
// A match counts as tracked on evidence that does not come from the match itself:
//   - enough of the scan lies on the map's planes, compared with the scans before, and what meets
//     them fits better than chance would;
//   - it lies within what the prediction allows, whose uncertainty grows with the gap; a match
//     beyond that, or after a gap or a loss, must fit the planes that it meets as well as scans did
//     before, and be clearly better than every other place that a search finds;
//   - planes and prediction together leave no direction unknown by more than max_sigma_m, unless
//     the sensor was tracked along it up to the scan before.
// All else is lost: the pose is the prediction, and must not enter a map.
#pragma once

#include <deque>
#include <functional>
#include <vector>

#include "core/geometry/scan.h"
#include "core/geometry/state_archive.h"
#include "core/map/voxel_map.h"
#include "frontend/matching/direction_profile.h"
#include "frontend/matching/pose_search.h"
#include "frontend/matching/scan_matcher.h"
#include "frontend/odometry/lost_track.h"
#include "frontend/odometry/motion_model.h"
#include "frontend/odometry/odometry_frame.h"
#include "frontend/odometry/odometry_options.h"
#include "frontend/odometry/shaken_sweep.h"
#include "frontend/odometry/sweep_acceleration.h"
#include "frontend/scan/scan_clusters.h"

namespace lamina {

// Not thread-safe; deterministic.
class Odometry {
 public:
  explicit Odometry(const OdometryOptions& options);

  // Where a scan is expected, from the state alone.
  SE3 Predict(StampNs stamp_ns) const { return motion_.Predict(stamp_ns).T_world_lidar; }
  // Whether a scan of that time, if it is lost, may be found by a search for where it is expected.
  bool InReach(StampNs stamp_ns) const { return Searchable(motion_.Predict(stamp_ns)); }
  // Pose of a scan from the state and the map. The state stays as it is until Accept. In a map that
  // is older than the drive, one that knows no speed yet is searched for about the prediction: a
  // street looks much the same a metre on, and a match settles where it begins.
  OdometryFrame Register(StampNs stamp_ns, const std::vector<TimedCluster>& clusters,
                         const VoxelMap& map, bool map_is_older = false) const;

  // The same from a pose that Register has just found, in a map that has changed a little since:
  // no search, and the status stays, unless too little of the map is met.
  void Rematch(const std::vector<TimedCluster>& clusters, const VoxelMap& map,
               OdometryFrame* frame) const;

  // Where the map has the scans of a track that was lost: the pose of its newest one. They are
  // expected where the first of them would have been, and believed on more evidence than a scan
  // that was never lost. A track that the map straightens is looked for anew.
  // Without `search` no match is tried, and the prediction is all that is filled in.
  OdometryFrame FindAgain(StampNs stamp_ns, const VoxelMap& map, bool search,
                          LostTrack* track) const;

  // Makes a frame the last one: the next prediction starts from it. Not for lost frames, unless
  // mapping is to start anew from there.
  void Accept(const OdometryFrame& frame);
  // A frame that was called lost: the next one is for FindAgain.
  void Lose() { lost_ = true; }
  // No match of the frame is to be trusted: it is lost, and the prediction stands for its pose, its
  // motion and its covariance.
  void Reject(OdometryFrame* frame) const;
  bool lost() const { return lost_; }
  // The last pose moves: T -> correction * T.
  void Correct(const SE3& correction) { motion_.Correct(correction); }
  // Where the motion is not known yet, a sensor is taken for shaken only if this says so: with the
  // first scan deskewed by its motion as well, the ordinary way may explain the second one.
  void MayBeShaken(bool may_be) { may_be_shaken_ = may_be; }
  // Whether a frame at the start, as the ordinary way has it, leaves room for that.
  bool SeemsShaken(const OdometryFrame& frame) const;
  // Whether stamps are measured. Before a scan.
  void SetStampsRecorded(bool recorded) { motion_.SetStampsRecorded(recorded); }
  // A body twist of the last frame that is known better than from the way since the frame before.
  void Assume(const Vector6d& twist) { motion_.Assume(twist); }
  void Assume(const Vector6d& twist, double over_s) { motion_.Assume(twist, over_s); }
  void StartMoving(const Vector6d& twist) { motion_.StartMoving(twist); }
  // Begins anew with poses that are known otherwise: forgets all, then takes one after the other.
  void StartOver();
  void Accept(StampNs stamp_ns, const SE3& T_world_lidar);
  // Takes over what another one knows of the motion and of how scans fit.
  void GoOnFrom(const Odometry& before);
  // Makes this pose the last one: the next scan is expected there.
  void StartAt(const SE3& T_world_lidar);

  void Archive(StateArchive& a);

  // Whether there is a last pose.
  bool started() const { return motion_.started(); }
  const MotionModel& motion() const { return motion_; }
  const Vector6d& velocity() const { return motion_.velocity(); }
  Vector6d Twist(StampNs stamp_ns) const { return motion_.Twist(stamp_ns); }
  // The share of a scan that lay on the map's planes of late, the median; 0 before a scan was
  // tracked.
  double RecentInliers() const;

 private:
  // Where the newest scan of the track is expected.
  PosePrediction PredictTrack(const LostTrack& track) const;
  // The best match of the track's scans together, and what was searched for.
  void SearchTogether(const SearchedScan& scan, PoseHypotheses* hypotheses,
                      OdometryFrame* frame) const;
  // Puts the newest scan of a track that was found where the map has that scan alone, if it
  // determines it, and says whether it has: the track holds its scans together only as well as they
  // see one another.
  bool SettleNewest(const LostTrack& track, const PosePrediction& prediction, const VoxelMap& map,
                    OdometryFrame* frame) const;
  // Distance of a match from the prediction in standard deviations of both.
  static double SigmasApart(const PosePrediction& prediction, const MatchResult& match);
  // A match this near to its prediction never surprises: jolts move a sensor as far.
  static constexpr double kLeastSurpriseM = 0.1;
  // Whether a match is farther from the prediction than its uncertainty explains.
  bool Surprising(const MatchResult& match, const PosePrediction& prediction) const;
  // A scan on its way to a pose.
  struct Attempt {
    const std::vector<TimedCluster>& clusters;
    const PosePrediction& prediction;
    const VoxelMap& map;
    int passes = 0;  // with which it is deskewed
    OdometryFrame frame = {};
    std::vector<PointCluster> deskewed = {};  // by frame.sweep

    void Deskew(const SweepMotion& sweep);
    // Another one of the same scan, which is searched for as well and not matched yet.
    Attempt Anew(int deskew_passes) const;
    // Of the same scan.
    void Take(Attempt&& other);
  };
  // Puts a match near the prediction in the place of such a one if planes say as much for it, and
  // one from another start if they say more.
  void SettleSurprise(Attempt* attempt) const;
  // The same once the motion during the scan is known: descends from the prediction with what that
  // motion is besides the way since the last scan. Each match of a shaken scan is deskewed for the
  // pose that the one before it found, and no descent leaves a minimum for which it is deskewed.
  void SettleSweepSurprise(Attempt* attempt) const;
  // Whether the match turns by what a prediction from the turn before does not foresee, as of a
  // sensor that is shaken: a descent may have ended beside a deeper minimum, among trees some
  // degrees away.
  bool MayBeTurned(const MatchResult& match, const PosePrediction& prediction) const;
  // Puts the deepest minimum that turns about each axis lead to in the place of such a match.
  void SettleTurn(Attempt* attempt) const;
  // Whether planes say more for `other`, or as much, and it is not surprising and `match` is.
  bool Deeper(const MatchResult& other, const MatchResult& match,
              const PosePrediction& prediction) const;
  // Takes back a search that led to a place that is not believed, and that planes say no more for
  // than for a match near the prediction that is as expected: such as the place where an earlier
  // visit lies in the map, which has drifted since.
  void ReturnToPrediction(Attempt* attempt) const;
  // Whether a match is farther from the prediction than matching alone may carry it.
  bool Leaps(const MatchResult& match, const PosePrediction& prediction) const;
  // Whether the prediction is as near as matching alone can bridge.
  bool WithinReach(const PosePrediction& prediction) const;
  // Whether a match is so near a prediction that is not much worse, and fits so well, that another
  // place is not to be expected.
  bool AsExpected(const MatchResult& match, const PosePrediction& prediction) const;
  // Whether a match is where the motion before leads, within what that is off by in a second: of
  // all the places about, a wrong one lies there by chance alone, however unsure the prediction is.
  static bool WhereMotionLeads(const MatchResult& match, const PosePrediction& prediction);
  // Whether a match near the prediction needs no other evidence.
  bool Vouches(const MatchResult& match, const PosePrediction& prediction) const;
  // Whether matching alone cannot be trusted to find the way.
  bool NeedsSearch(const MatchResult& match, const PosePrediction& prediction) const;
  PoseHypotheses Hypotheses(const PosePrediction& prediction, bool map_is_older) const;
  // Whether the match is where the sensor was last, and sees what it saw then: it paused.
  bool StoodStill(const MatchResult& match) const;
  // Whether a search covers what the prediction leaves open.
  bool Searchable(const PosePrediction& prediction) const;
  // Whether a match is to be believed. `unique` tells whether a search finds no rival to it.
  bool Believed(const OdometryFrame& frame, const SearchedScan& scan,
                const std::function<bool()>& unique) const;
  // Deskews and matches so often with the motion that each match finds, and with how the sensor
  // accelerated meanwhile (sweep_acceleration.h).
  void MatchDeskewed(Attempt* attempt) const;
  // The same for a sensor that is shaken (shaken_sweep.h), where it seems to be. `before`: the
  // motion under which the frame was matched before, if any.
  void MatchShaken(const SweepMotion& before, Attempt* attempt) const;
  // The motion during the frame's scan if it was at this pose instead.
  SweepMotion SweepAt(const SE3& T_world_lidar, const OdometryFrame& frame) const;
  // The motion during a scan at this pose, `dt` after the last one, with that acceleration.
  SweepMotion SweepTo(const SE3& T_world_lidar, const Vector6d& acceleration, double dt) const;
  // Where few surfaces face the direction that the match knows least, or the blocks that it meets
  // would have it elsewhere (BlockStep): puts the pose where surfaces and the motion before it
  // together have it (direction_profile.h).
  void SettleWeakest(Attempt* attempt) const;
  // Where surfaces alone would have a match elsewhere along a direction, and the motion before it
  // holds it where it is: one of the two is wrong, and the match is degenerate there.
  void DoubtContradicted(const DirectionProfile& profile, double settled_m,
                         const Vector6d& direction, OdometryFrame* frame) const;
  // Whether the prediction leaves the direction that a match knows least to the search.
  bool Unbridged(const PosePrediction& prediction, const MatchResult& match) const;
  // What a search has found there where few surfaces face it.
  void DoubtUnbridged(const PosePrediction& prediction, const std::vector<PointCluster>& deskewed,
                      const VoxelMap& map, OdometryFrame* frame) const;
  // As SettleWeakest, where the motion before is as unsure: the match stays, with what else it may
  // be along the direction in its covariance. Degenerate where that is much.
  void DoubtWeakest(const DirectionProfile& profile, const Vector6d& direction,
                    OdometryFrame* frame) const;
  // A match that has left a prediction along the direction that it knows least by more than both
  // explain, as things make it that move along, stays as well, and is degenerate there.
  void DoubtSurprising(const PosePrediction& prediction, OdometryFrame* frame) const;
  // Of a scan that is lost right after others: a sensor that begins to turn bends it by that turn,
  // and deskewed by the motion before it fits nowhere. Tries it as turned by as much as a search
  // goes, about each axis, and deskewed by that turn.
  void FindTurn(const PoseHypotheses& hypotheses, Attempt* attempt) const;
  // Whether a frame is the second one: no motion is known yet.
  bool Starting(bool map_is_older) const;
  // The same as Register once started, deskewed so often; 0: the scan as it is, by what is known of
  // the motion.
  OdometryFrame RegisterDeskewed(StampNs stamp_ns, const std::vector<TimedCluster>& clusters,
                                 const VoxelMap& map, bool map_is_older, int passes) const;
  // How often a scan is deskewed again.
  int DeskewPasses(StampNs stamp_ns, const std::vector<TimedCluster>& clusters) const;
  // Status and pose of a frame that was matched.
  void Judge(const SearchedScan& scan, const PoseHypotheses& hypotheses,
             OdometryFrame* frame) const;
  // Where a frame that is believed may be instead; `searched`: that it is believed because no rival
  // was found.
  Vector6d Elsewhere(const SearchedScan& scan, const PoseHypotheses& hypotheses,
                     const OdometryFrame& frame, bool searched) const;

  OdometryOptions options_;
  ScanMatcher matcher_, narrow_matcher_;
  PoseSearch search_;
  MotionModel motion_;
  RecentAccelerations accelerations_;
  static constexpr std::size_t kRecentScans = 15;
  ShakenSweep shaken_;
  bool may_be_shaken_ = false;  // at the start of a map; not archived: set anew for each scan
  std::deque<double> recent_inliers_, recent_fits_;
  bool lost_ = false;                                   // since the last accepted frame
  Vector6d elsewhere_ = Vector6d::Zero();               // of the last accepted frame
  UnsteadyMotion last_shake_ = UnsteadyMotion::Zero();  // of the last tracked one; 0 if not shaken
};

}  // namespace lamina
