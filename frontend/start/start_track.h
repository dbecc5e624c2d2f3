// The first scans of a drive, as long as more than one motion explains them.
//
// Among much that moves (traffic at the sensor's speed, vans about it, a lorry alongside) two scans
// have several motions that fit: that of the static world, and that of each thing that moves. Their
// minima lie decimetres apart, and which is the deepest is decided by what happens to stand near.
// A scan or two later it is not: the static world goes on with the sensor's motion, each thing that
// moves with its own. So every motion that fits is followed as a hypothesis, through the scans that
// come and in a map of its own, until one is clearly better than all others, or for so many scans
// that the best of them is taken.
//
// Hypotheses are trajectories that differ along the unit vector u, the direction that the fewest
// planes face: there few clusters decide. Each minimum of the second scan begins one; where the
// sensor sees far, so do faint minima of high speed, since among traffic as fast as the sensor few
// static surfaces face the motion. Each later scan is placed where the motion so far leads, or in a
// minimum beside that, so that a trajectory may branch later: a lorry that starts alongside is half
// a metre behind only after eight scans. Cluster i of each scan meets a plane under a hypothesis at
// some distance, and has there the fit f_i of matching/plane_score.h, with a scale as narrow as
// minima are. Two hypotheses are compared by blocks of 4 m about the sensor, in which clusters are
// of one thing and move together: block b has one vote, however near and large that thing is,
//
//     v_b = D_b / sqrt(1 + D_b^2),    D_b = sum (f'_i - f_i),    z = sum v_b / sqrt(sum v_b^2),
//
// and by whether a sensor moves like that: each change of speed along u, in standard deviations c_k
// of the motion options' acceleration, costs
//
//     U = sum_k 2 log(1 + c_k^2).
//
// A hypothesis is refuted by another, z' and U', when z |z| + U - U' > c^2, that is, by c standard
// deviations. Clusters that meet no plane under one of the two say nothing: how much of a scan
// meets planes tells how widely the scans before are spread, not whether they are where they
// belong.
//
// If scans have few points and a match leaves the translation open, minima arise by chance
// everywhere. Then a trajectory counts only if it is steady; otherwise, after all scans, the start
// is given up, so that no map begins with them.
//
// Without recorded stamps steps may be uneven, and steadiness does not tell trajectories apart.
// Then a steady motion speaks against odometry's trajectory only if it makes a sharper map, as for
// a sensor that the sheets of its own rings hold where it stood; otherwise that trajectory is kept.
//
// In a corridor or a tunnel no surface faces the direction of travel. Lines of the rings on floor
// and walls then coincide by chance, at some speed more sharply than at others, which is no
// evidence: a trajectory is rejected if nothing faces it in the map that it makes. If both
// odometry's and the one that refutes it are rejected, and the scans overlap all the same, the
// simplest explanation is taken, a sensor that stands, and the poses are called degenerate.
//
// If everything around starts together with the sensor, it may be mistaken for the static world:
// two scans have no other minimum, and each further scan is held where the ones before were. So the
// trajectory of a sensor that stands or starts is checked again with all scans, against the steady
// motion that makes their map the sharpest (steady_motion.h): `fine` at the sensor's noise, `rough`
// at decimetres. Fine is the more exact; but scans from one place have their points on the same
// lines of everything, which makes edges, foliage and cars look as sharp as walls, at decimetres
// hardly. The first of these cases that applies decides (StartTrack::CheckSettingOff):
//
//   1. The trajectory moves, fine is near it (or a little farther and no sharper), and rough does
//      not doubt it: it is right.
//   2. Neither fine nor rough differs from odometry's: that is right. If fine still refutes it,
//      objects that moved along have biased it by centimetres, and the scans settle on fine. If
//      odometry stands and starting would give as sharp a map, the trajectory is undecided, and the
//      start is given up.
//   3. Rough does not differ, and fine does not differ or does not refute it: it is right.
//   4. Fine and rough both refute it, and agree on another motion: that overrules it.
//   5. Otherwise the trajectory is undecided, and the start is given up: the next one begins with a
//      sensor that moves, of which two scans show the static world and objects moving along as two
//      minima.
//
// A sensor that stands is given up only once: in a start that follows one that was given up it is
// taken for right in cases 2 and 5.
//
// A sensor in motion may likewise be matched to objects that move along, where these fill a narrow
// view: two scans show the static world as a second minimum only if the two lie far enough apart,
// and if it is not much weaker. So that trajectory is checked as well, with few scans, with many
// and with all: if a steady motion refutes it at the sensor's noise and at decimetres, it is
// doubted, and with the last scan overruled; if with many scans it refutes all of these itself, it
// is right. Another trajectory than odometry's, the one left of several, is doubted already if fine
// and rough both find another motion likelier: that all others are refuted does not make it right.
//
// A shaken sensor has the motion during each scan from that scan (SweepMotion::of_scan). Its poses
// deviate from a steady trajectory by the shaking, so that steps from scan to scan do not tell
// trajectories apart: no hypotheses are followed. All else is checked as above, each scan deskewed
// by its own motion.
//
// If scans of few points, no two with the same rays, share few planes, as among trees, matches are
// biased to where lines coincide with lines. There beams determine the motion from scan to scan
// (beam_agreement.h), and then each scan is matched to the map of all others. The result is taken
// if the beams agree clearly better about it than about odometry's trajectory, and less to every
// side of it.
#pragma once

#include <cstdint>
#include <vector>

#include "core/geometry/scan.h"
#include "core/geometry/se3.h"
#include "core/geometry/state_archive.h"
#include "core/map/voxel_map.h"
#include "frontend/matching/scan_matcher.h"
#include "frontend/odometry/odometry.h"
#include "frontend/start/start_scans.h"
#include "frontend/start/steady_motion.h"

namespace lamina {

// Not thread-safe; deterministic.
class StartTrack {
 public:
  StartTrack(const OdometryOptions& options, const VoxelMapOptions& map_options);

  enum class State : std::uint8_t {
    kOpen,       // the next scan is wanted
    kKept,       // odometry's way is kept, or may not be doubted any more
    kOverruled,  // another hypothesis than odometry's way is left
    kToldByAll,  // overruled by the one motion that all scans together explain
    kStands,     // overruled by a sensor at rest, where nothing determines its motion
    kGivenUp,    // no trajectory explains the scans: their map is unusable
  };
  // Whether the start is undecided: until one hypothesis is left or taken.
  bool open() const { return state_ == State::kOpen; }
  // Whether there is more than one hypothesis, or the way is open.
  bool contested() const { return open() && (own_way_ == OwnWay::kOpen || !hypotheses_.empty()); }

  // To be called before the first scan, if these scans follow others that were lost in their map,
  // or whose start was given up.
  void FollowPiece(bool given_up) {
    unproven_ = true;
    after_given_up_ = given_up;
  }
  // Whether they follow such ones, and nothing shows yet that odometry does better with them: the
  // sensor may be in motion, hidden by objects that move along.
  bool unproven() const { return open() && unproven_; }

  // The next scan, and what odometry made of it. The first has no match. The second gives the
  // hypotheses about its match; scans that are far apart in time, or made-up stamps, give none.
  void Add(const OdometryFrame& frame, bool stamp_made_up,
           const std::vector<TimedCluster>& clusters);

  // After the second scan: the motion during the first one, if that looks shaken as well.
  void ShakeFirst(const SweepMotion& sweep);

  // Whether odometry is overruled: scans() has the poses and motions of all scans so far under
  // another hypothesis, and match() is that of the newest. Its MatchResult::degenerate_information,
  // if any, is to hold all of them.
  bool overruled() const { return state_ == State::kOverruled || told_by_all() || stands(); }
  // Whether all scans together overruled it: each pose then has a standard deviation of kToldM.
  bool told_by_all() const { return state_ == State::kToldByAll; }
  static constexpr double kToldM = 0.05;
  bool given_up() const { return state_ == State::kGivenUp; }
  bool stands() const { return state_ == State::kStands; }
  // Whether odometry's poses may be chance: the scans so far do not determine the motion along the
  // direction that a match left open, or refute those poses, or another trajectory is the best so
  // far.
  bool unsettled() const;
  const std::vector<StartScan>& scans() const { return scans_.all(); }
  const MatchResult& match() const { return match_; }
  // Closes the start without a result and frees its scans.
  void Clear();
  // Returns to the state before the first scan. FollowPiece() is forgotten if the start has closed
  // since.
  void BeginAgain();
  // All poses move: T -> correction * T.
  void Move(const SE3& correction);

  // While contested: what the hypotheses leave unknown of the newest pose, on top of a match's
  // covariance; tangent of core/geometry/se3.h.
  Matrix6d Spread(const SE3& T_world_lidar) const;

  // Between scans.
  void Archive(StateArchive& a);

 private:
  struct Hypothesis {
    std::vector<SE3> poses;  // T_world_lidar of each scan
    // Fit of each cluster of all scans but the first; negative where there is no plane.
    std::vector<float> fits;
    MatchResult match;  // of the newest; not archived

    void Archive(StateArchive& a) { a(&poses, &fits); }
  };
  static constexpr std::size_t kMostHypotheses = 8;
  // Scans after which a trajectory may first be refuted, after which a steady motion may decide,
  // and after which the start is decided.
  static constexpr std::size_t kFewScans = 5, kManyScans = 8, kMostScans = 13;
  // Trajectories that nowhere differ by more are the same.
  static constexpr double kSameWayM = 0.05;
  static bool SameWay(const std::vector<SE3>& a, const std::vector<SE3>& b);
  // A steady motion agrees with a trajectory that differs by less than this ...
  static constexpr double kAgreesM = 0.15;
  // Two motions that are the same may differ by as much, each being found to half of that.
  static constexpr double kAlikeM = 2.0 * kAgreesM;
  // ... and determines it if its speed is known to this.
  static constexpr double kKnownMS = 1.0;
  // Standard deviations by which one trajectory is likelier than another, and makes it doubtful.
  static constexpr double kLikelySigmas = 1.0, kDoubtedSigmas = 2.0;
  // By how many standard deviations `a` is better than `b`.
  double Better(const Hypothesis& a, const Hypothesis& b) const;
  // SteadyMotionOptions::max_speed_m_s, by the visible range of the first scan.
  double MaxSpeedMS() const;
  // Variance of the change of velocity between the step to a scan and the step before it: by the
  // motion options' acceleration, and by three poses that are wrong by `pose_m`, one sigma each.
  double ChangeVariance(std::size_t scan, double pose_m) const;
  // U of a way.
  double Unsteadiness(const std::vector<SE3>& poses) const;
  // Whether U is what the motion options lead to expect.
  bool Steady(const std::vector<SE3>& poses) const;
  // Records that a scan looks shaken, and its motion beside that of odometry's poses.
  void Shake(std::size_t scan, const SweepMotion& sweep);
  // Poses at local minima along u, offset from the given one by `middle_m` +- `reach_m`.
  std::vector<SE3> Minima(const std::vector<PointCluster>& clusters, const SE3& T_world_lidar,
                          const VoxelMap& map, double middle_m, double reach_m) const;
  void Begin(const OdometryFrame& frame);
  // The continuations of a hypothesis by the newest scan: where its motion leads, and in the minima
  // beside that.
  std::vector<Hypothesis> Follow(const Hypothesis& hypothesis) const;
  // Matches its newest pose, with deskewed clusters, to the nearest minimum; false if too little
  // matches.
  bool Match(const VoxelMap& map, const std::vector<PointCluster>& clusters,
             Hypothesis* hypothesis) const;
  // The same for the second scan, deskewed by the motion that the match finds.
  bool MatchSecond(Hypothesis* hypothesis) const;
  // Sorts the hypotheses, the best first, and drops those that are refuted or equal another.
  void Rank();
  void Decide();
  // Odometry's way is the only one left: closes, or waits to be checked with all scans.
  void Trust();
  // Whether the sensor is so slow, by these poses, that objects which look static may move along
  // with it; a faster one would have left them behind.
  bool Slow(const std::vector<SE3>& poses) const;
  // Whether it is slow, and its first step is that of a sensor at rest: it stands or has just set
  // off.
  bool SettingOff(const std::vector<SE3>& poses) const;
  // Closes by the table above, with the last scan. `poses`: odometry's, or those of the best
  // hypothesis.
  void CheckSettingOff(const std::vector<SE3>& poses);
  // Doubts odometry's way where a steady motion refutes it. The last scan closes: with odometry's
  // way, or, if that is refuted, with that motion in its place, or gives up.
  void CheckGoingAlong(const std::vector<SE3>& own, bool last);
  // Closes with the best hypothesis. If steady motions doubt one that is slow, it waits for more
  // scans; the last one closes with a motion that refutes it, or gives up.
  void CheckBest();
  // Whether nothing faces a way, neither under odometry's motion nor under a steady one that
  // refutes it. Another start would be no better.
  bool IsTunnel(const Eigen::Vector3d& along) const;
  // Closes as if the sensor stood along that way. False if something faces it, or if the scans meet
  // little of one another.
  bool TakeStanding(const Eigen::Vector3d& along);
  // Closes with the best hypothesis; as if the sensor stood, or with odometry's way, if nothing
  // faces u.
  void TakeBest();
  void GiveUp();
  // Closes with the steady motion that makes the sharpest map, along the direction that a match
  // left open and along that across the sensor's vertical axis which the fewest planes face, in
  // which most sensors travel; or, since matches may turn scans of few points wrongly, with one
  // without a turn. False if it is no sharper than odometry's, or too ambiguous. Odometry counts as
  // refuted if it is none of the motions that are possible, or if another one is likelier, though
  // perhaps not known well enough yet.
  bool TakeSteady();
  // Closes with these poses, each matched to the map of all others, and the twists of `steady`. If
  // scans settle far from the given poses, matching is repeated in rounds. False, without any
  // change, if a scan matches too little, if the settled poses leap, or if nothing faces `u`.
  bool TakeSettled(std::vector<SE3> poses, const std::vector<SE3>& steady,
                   const Eigen::Vector3d& u);
  // Matches a scan to the map of all others; along u only within kToldM, by the profile of the few
  // surfaces there (direction_profile.h). False if too little matches.
  bool SettleBeside(std::size_t scan, const Eigen::Vector3d& u, std::vector<SE3>* poses,
                    MatchResult* match) const;
  // Whether anything faces u: the blocks of 4 m that face it in the map of all other scans
  // (DirectionProfile::Blocks), the mean over the scans, are at least `least_blocks`.
  bool IsFaced(const Eigen::Vector3d& u, const std::vector<SE3>& poses, double least_blocks) const;
  // Least blocks under a steady motion: it has 0 to 0.8 in corridors and tunnels, 5 to 15 in
  // streets, 1.1 and more with few rays. Under the best of several hypotheses, each of which fits
  // as well as it can where it is, rings in corridors make 2.5, static surfaces among traffic 8 and
  // more.
  static constexpr double kSteadyBlocks = 1.0, kBestBlocks = 4.0;
  // Whether the velocity changes from step to step by more than the motion options allow.
  bool Leaps(const std::vector<SE3>& poses) const;
  // Whether the second scan meets few planes of the first, and repeats few of its rays: repeated
  // rays agree on the ground wherever the sensor is, and best where it stands.
  bool ToldByBeams(const MatchResult& second) const;
  // Matches each scan to the map of all others, in rounds; *match is that of the last.
  bool SettleAll(std::vector<SE3>* poses, MatchResult* match) const;
  // Whether the sensor stands by these poses, and its rays are repeated but end elsewhere each
  // time.
  bool BeamsContradict(const std::vector<SE3>& poses) const;
  // Closes with the poses that beams agree on, where odometry's are refuted by them.
  bool TakeByBeams();
  // SettleBeside of all scans but the first; *match is that of the last.
  bool SettleOthers(const Eigen::Vector3d& u, std::vector<SE3>* poses, MatchResult* match) const;
  // The steady motion along one direction, compared with given poses.
  struct SteadyAlong {
    std::vector<SE3> poses;  // under the motion
    Eigen::Vector3d along = Eigen::Vector3d::UnitX();
    double speed_m_s = 0.0;
    double open_speed_m_s = 0.0;  // ambiguity of the speed; infinite if not asked for
    double apart_m = 0.0;         // largest distance between the two
    double sharper = 0.0;         // by so many standard deviations; negative if the given poses are
    bool told = false;            // the speed is known well enough
    bool refutes = false;         // it clearly refutes the given poses
    bool refuted = false;         // the given poses refute all motions well apart from them
  };
  // Closes with that motion.
  bool TakeSettled(const SteadyAlong& steady) {
    return TakeSettled(steady.poses, steady.poses, steady.along);
  }
  // What to compute, by increasing cost. kIfRefutes: the motion, unless the given poses refute all
  // others. kOpenSpeedIfRefutes: the motion, and the ambiguity of its speed if it refutes the
  // poses. kAll: both.
  enum class Asked { kIfRefutes, kOpenSpeedIfRefutes, kAll };
  SteadyAlong FindAlong(const std::vector<SE3>& from, const Eigen::Vector3d& u, double noise_m,
                        Asked asked) const;
  // The same along the direction that the fewest planes face.
  SteadyAlong FindAhead(const std::vector<SE3>& from, double noise_m,
                        Asked asked = Asked::kOpenSpeedIfRefutes) const;
  // Whether the motions found at the sensor's noise and at decimetres both refute the given poses,
  // and agree on what they are instead.
  static bool Refute(const SteadyAlong& fine, const SteadyAlong& rough);
  // Whether, by these poses, the sensor has left behind what may have set off with it, or all scans
  // tell the two apart.
  bool Parted(const std::vector<SE3>& poses) const;
  // Steady motions along several directions, one after the other.
  struct SteadyWay {
    std::vector<SE3> poses;   // moved by the motions that refute them
    std::vector<SE3> moving;  // under all motions that are known
    bool moved = false;
    bool refuted = false;      // by a motion of ambiguous speed
    bool doubted = false;      // a motion differs and is likelier, but does not refute them
    bool ahead_known = false;  // the speed along the first direction is known
    Eigen::Vector3d known = Eigen::Vector3d::Zero();  // the last direction of known speed
    double open_speed_m_s = 0.0;  // largest ambiguity of the motions that moved them
  };
  // Error of the first and the last pose due to that ambiguity, m.
  double OpenM(const SteadyWay& way) const;
  SteadyWay FindSteady(const std::vector<SE3>& from,
                       const std::vector<Eigen::Vector3d>& directions) const;
  // Steady motion straight ahead, across the sensor's vertical axis, without a turn. False if it is
  // not likelier than `other`.
  bool FindStraight(const std::vector<SE3>& other, std::vector<SE3>* poses) const;
  // The scans as if the sensor had not moved along u; *own: its motion along u by these poses.
  std::vector<SteadyScan> WithoutWay(const std::vector<SE3>& poses, const Eigen::Vector3d& u,
                                     WayAlong* own) const;
  // Closes with these poses, and with the twists between the poses `moving`.
  void Overrule(const std::vector<SE3>& poses, const std::vector<SE3>& moving,
                const MatchResult& match);

  ScanMatcher matcher_;
  double open_sigma_m_;
  SteadyMotionOptions steady_;
  State state_ = State::kOpen;
  bool unproven_ = false;        // FollowPiece(), and no trajectory is proved yet
  bool after_given_up_ = false;  // after a start that was given up
  // Properties of the scans so far.
  struct Seen {
    bool all_tracked = true, stamps_recorded = true;
    bool sparse = false;             // ToldByBeams
    bool shaken = false;             // some scan looked so
    std::size_t without_planes = 0;  // scans whose planes leave a direction open
  };
  Seen seen_;
  // What supports odometry's way.
  enum class OwnWay : std::uint8_t {
    kHeld,        // matches leave nothing open
    kOpen,        // one left it open, by open_m_ at most, along open_along_
    kUnrivalled,  // it is the only way left
  };
  OwnWay own_way_ = OwnWay::kHeld;
  // Many scans together refute odometry's way; only all scans may then decide for another.
  bool refuted_ = false;
  double open_m_ = 0.0;
  Eigen::Vector3d open_along_ = Eigen::Vector3d::Zero();
  StartScans scans_;  // under the hypothesis that is left, once overruled
  std::vector<Hypothesis> hypotheses_;
  MatchResult match_;
  Eigen::Vector3d u_ = Eigen::Vector3d::UnitX();
};

}  // namespace lamina
