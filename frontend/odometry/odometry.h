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

  // Predicted pose of a scan, from the state alone.
  SE3 Predict(StampNs stamp_ns) const { return motion_.Predict(stamp_ns).T_world_lidar; }
  // Whether a search around the prediction for that time covers its uncertainty.
  bool InReach(StampNs stamp_ns) const { return Searchable(motion_.Predict(stamp_ns)); }
  // Pose of a scan from the state and the map. The state stays as it is until Accept. In a map
  // older than the drive a scan without a known speed is searched for about the prediction: a
  // street looks much the same a metre on, and a match converges to the minimum nearest to its
  // start.
  OdometryFrame Register(StampNs stamp_ns, const std::vector<TimedCluster>& clusters,
                         const VoxelMap& map, bool map_is_older = false) const;

  // The same from a pose that Register has just found, in a map that has changed a little since:
  // no search, and the status stays, unless too little of the map is met.
  void Rematch(const std::vector<TimedCluster>& clusters, const VoxelMap& map,
               OdometryFrame* frame) const;

  // Searches the map for the scans of a lost track; the frame is that of the newest one. They are
  // expected where the first of them would have been, and need more evidence than a scan that was
  // never lost. A track that the map straightens is searched for again.
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
  // While no motion is known, the shaken model is tried only if this allows it: with the first scan
  // deskewed by its motion as well, the ordinary model may explain the second one.
  void MayBeShaken(bool may_be) { may_be_shaken_ = may_be; }
  // Whether the unshaken match of a second scan is poor enough to try the shaken model.
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
  // Median share of the recent scans that lay on the map's planes; 0 before a scan was tracked.
  double RecentInliers() const;

 private:
  // Predicted pose of the newest scan of the track.
  PosePrediction PredictTrack(const LostTrack& track) const;
  // The best match of the track's scans together, and what was searched for.
  void SearchTogether(const SearchedScan& scan, PoseHypotheses* hypotheses,
                      OdometryFrame* frame) const;
  // Replaces the pose of a found track's newest scan by the match of that scan alone, if that
  // determines it; true if so. The track holds its scans together only as well as they overlap.
  bool SettleNewest(const LostTrack& track, const PosePrediction& prediction, const VoxelMap& map,
                    OdometryFrame* frame) const;
  // Distance of a match from the prediction in standard deviations of both.
  static double SigmasApart(const PosePrediction& prediction, const MatchResult& match);
  // A match this near to its prediction never surprises: jolts move a sensor as far.
  static constexpr double kLeastSurpriseM = 0.1;
  // Whether a match is farther from the prediction than its uncertainty explains.
  bool Surprising(const MatchResult& match, const PosePrediction& prediction) const;
  // A scan while it is registered.
  struct Attempt {
    const std::vector<TimedCluster>& clusters;
    const PosePrediction& prediction;
    const VoxelMap& map;
    int passes = 0;  // deskewing passes
    OdometryFrame frame = {};
    std::vector<PointCluster> deskewed = {};  // by frame.sweep

    void Deskew(const SweepMotion& sweep);
    // A new attempt at the same scan, marked as searched and not matched yet.
    Attempt Anew(int deskew_passes) const;
    // Takes over another attempt at the same scan.
    void Take(Attempt&& other);
  };
  // Replaces a surprising match by one near the prediction if planes support it equally, or by one
  // from another start if they support it better.
  void SettleSurprise(Attempt* attempt) const;
  // The same once the motion during the scan is known: descends from the prediction, with the scan
  // deskewed for it. Each match of a shaken scan is deskewed for the pose that the one before it
  // found, and a descent does not leave the minimum for which the scan is deskewed.
  void SettleSweepSurprise(Attempt* attempt) const;
  // Whether the match turns by more than the prediction foresees, as for a shaken sensor: its
  // descent may have ended beside a deeper minimum, some degrees away among trees.
  bool MayBeTurned(const MatchResult& match, const PosePrediction& prediction) const;
  // Replaces such a match by the deepest minimum that turns about each axis lead to.
  void SettleTurn(Attempt* attempt) const;
  // Whether planes support `other` better than `match`, or equally if only `match` is surprising.
  bool Deeper(const MatchResult& other, const MatchResult& match,
              const PosePrediction& prediction) const;
  // Discards the result of a search that is not believed, if planes support a match near the
  // prediction at least as well: the search may have found where an earlier visit lies in the map,
  // which has drifted since.
  void ReturnToPrediction(Attempt* attempt) const;
  // Whether a match is farther from the prediction than matching alone may carry it.
  bool Leaps(const MatchResult& match, const PosePrediction& prediction) const;
  // Whether the prediction is as near as matching alone can bridge.
  bool WithinReach(const PosePrediction& prediction) const;
  // Whether a match is so near a prediction that is not much worse, and fits so well, that another
  // place is not to be expected.
  bool AsExpected(const MatchResult& match, const PosePrediction& prediction) const;
  // Whether a match is where the last motion leads, within the error of that over a second: a wrong
  // place lies there by chance alone, however uncertain the prediction is.
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
  // If few surfaces face the direction that the match knows least, or the votes of blocks
  // contradict the match (BlockStep): sets the pose along it to the mean of surfaces and prediction
  // (direction_profile.h).
  void SettleWeakest(Attempt* attempt) const;
  // If surfaces alone place a match elsewhere along a direction than they do together with the
  // prediction, one of the two is wrong: the match is degenerate there.
  void DoubtContradicted(const DirectionProfile& profile, double settled_m,
                         const Vector6d& direction, OdometryFrame* frame) const;
  // Whether the prediction is too uncertain along the direction that a match knows least to choose
  // among its minima, which leaves that to the search.
  bool Unbridged(const PosePrediction& prediction, const MatchResult& match) const;
  // Widens the covariance of such a match along that direction, if few surfaces face it.
  void DoubtUnbridged(const PosePrediction& prediction, const std::vector<PointCluster>& deskewed,
                      const VoxelMap& map, OdometryFrame* frame) const;
  // As SettleWeakest, if the prediction is too uncertain: the match stays, and its covariance takes
  // in the other minima along the direction. Degenerate if they are far.
  void DoubtWeakest(const DirectionProfile& profile, const Vector6d& direction,
                    OdometryFrame* frame) const;
  // A match that deviates from the prediction, along the direction that it knows least, by more
  // than the uncertainty of both, as with objects that move along, stays as well, and is degenerate
  // there.
  void DoubtSurprising(const PosePrediction& prediction, OdometryFrame* frame) const;
  // Tries again a scan that is lost right after others: a sensor that begins to turn distorts it by
  // that turn, and deskewed by the last motion it fits nowhere. Turns about each axis are tried, as
  // far as a search goes, each with the scan deskewed by that turn.
  void FindTurn(const PoseHypotheses& hypotheses, Attempt* attempt) const;
  // Whether a frame is the second one: no motion is known yet.
  bool Starting(bool map_is_older) const;
  // Register once started, with so many deskewing passes; 0: deskewed by the predicted motion
  // alone.
  OdometryFrame RegisterDeskewed(StampNs stamp_ns, const std::vector<TimedCluster>& clusters,
                                 const VoxelMap& map, bool map_is_older, int passes) const;
  // How often a scan is deskewed again.
  int DeskewPasses(StampNs stamp_ns, const std::vector<TimedCluster>& clusters) const;
  // Status and pose of a frame that was matched.
  void Judge(const SearchedScan& scan, const PoseHypotheses& hypotheses,
             OdometryFrame* frame) const;
  // Another place of a frame that is believed, as a tangent from its pose; `searched`: that it is
  // believed because no rival was found.
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
