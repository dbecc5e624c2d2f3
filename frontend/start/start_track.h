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
// Hypotheses are ways along the unit vector u, the direction that the fewest planes face: there few
// clusters decide. Each minimum of the second scan begins one, fast ones though it is faint, where
// the sensor sees far: among traffic as fast as the sensor little that faces the way stands. Each
// scan after it is where the motion so far leads, or in a minimum beside that, so that a way may
// part from another later: a lorry that starts alongside is half a metre behind only when eight
// scans have been taken. Cluster i of each scan meets a plane under a hypothesis at some distance,
// and has there the fit f_i of matching/plane_score.h, of a scale as narrow as minima are. Two
// hypotheses are compared by blocks of 4 m about the sensor, in which clusters are of one thing and
// move together: block b has one vote, however near and large that thing is,
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
// Where scans are of few points and a match leaves the way open, chance has a minimum everywhere.
// There a way counts only if it is steady; otherwise, after all scans, the start is given up: no
// map is to begin with them.
//
// Without recorded stamps steps may be even or not, and ways are not told apart by how steady they
// are. There a steady motion only speaks against odometry's way where it makes a sharper map, as of
// a sensor that the sheets of its own rings hold where it stood; otherwise that way is kept.
//
// Along a corridor and through a tunnel nothing faces the way. Then lines of the rings on floor and
// walls come to lie beside one another by chance, at some speed more sharply than at others, and
// say nothing: a way is none if nothing faces it in the map that it makes. If neither odometry's
// way is one nor another that refutes it, and the scans meet one another all the same, they are
// explained by the least, a sensor that stands, and are called degenerate.
//
// Where everything about sets off together with the sensor, all of that may be held for what
// stands: two scans have no other minimum, and each scan more is held where the ones before were.
// So the way of a sensor that stands or sets off is asked about once more when all scans are there,
// whatever they said one after the other: for the steady motion that makes their map the sharpest
// (steady_motion.h), once by the sensor's noise and once by decimetres. The first is the more
// exact; but scans from one place have their points on the same lines of everything, which makes
// edges, foliage and cars look as sharp as walls, and to decimetres they hardly do. A way from
// which neither differs is right, if not to the centimetre: scans that what goes along has drawn
// aside settle on the exact motion where that refutes them. A way that stands where setting off
// would be as sharp is not told, though neither differs. Right is also one that does not stand, if
// the exact motion is near it and no sharper, and the other does not doubt it. One that both refute
// is overruled, if they agree on what it is instead. All else is not told yet, and the start is
// given up: the next one begins with a sensor that moves, of which two scans show what stands and
// what goes along as two minima.
//
// So may the way of a sensor in motion be that of what goes along with it, where that fills a
// narrow view: two scans show what stands as a second minimum only if the two lie far enough apart,
// and if it is not much less. So that way is asked about as well, with few scans, with many and
// with all: where a steady motion refutes it to the sensor's noise and to decimetres, it is
// doubted, and with the last scan overruled; where with many scans it refutes all of these itself,
// it is right. Another way than odometry's, the one left of several, is doubted already where both
// find another motion likelier: that all others are refuted does not say that it is right.
//
// A sensor that is shaken has the motion during each scan from that scan (SweepMotion::of_scan).
// Its poses lie beside a steady way by what it shakes, so that steps from scan to scan do not tell
// ways apart: no hypotheses are followed. All else is asked as above, each scan deskewed by its own
// motion.
//
// Where scans of few points, no two of the same rays, meet few planes of one another, as among
// trees, matches are drawn to where lines lie on lines. There the beams tell the motion from scan
// to scan (beam_agreement.h), and then each scan finds its place in the map of all others. If the
// beams agree clearly better about that way than about odometry's, and less to every side of it, it
// is taken.
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
    kStands,     // overruled by the least that explains the scans, where nothing tells their way
    kGivenUp,    // no way explains the scans: what they made of a map is of no use
  };
  // From the first scan on until one hypothesis is left or taken.
  bool open() const { return state_ == State::kOpen; }
  // Whether there is more than one hypothesis, or the way is open.
  bool contested() const { return open() && (own_way_ == OwnWay::kOpen || !hypotheses_.empty()); }

  // Before the first scan: these follow others whose map they were lost to, or whose start was
  // given up.
  void FollowPiece(bool given_up) {
    unproven_ = true;
    after_given_up_ = given_up;
  }
  // Whether they follow such ones, and nothing tells yet that odometry does better with them: the
  // sensor may be in motion, and what moves along hides that.
  bool unproven() const { return open() && unproven_; }

  // The next scan, and what odometry made of it. The first has no match. The second gives the
  // hypotheses about its match; scans that are far apart in time, or made-up stamps, give none.
  void Add(const OdometryFrame& frame, bool stamp_made_up,
           const std::vector<TimedCluster>& clusters);

  // After the second one: the motion during the first, if that looks shaken as well.
  void ShakeFirst(const SweepMotion& sweep);

  // Whether scans() has all scans so far under another hypothesis than odometry's, the first one
  // where odometry has it, with their motions, and match() is that of the newest. What holds it
  // along the way (MatchResult::degenerate_information), if anything, is to hold all.
  bool overruled() const { return state_ == State::kOverruled || told_by_all() || stands(); }
  // That leaves kToldM open of each pose, a standard deviation.
  bool told_by_all() const { return state_ == State::kToldByAll; }
  static constexpr double kToldM = 0.05;
  bool given_up() const { return state_ == State::kGivenUp; }
  bool stands() const { return state_ == State::kStands; }
  // Whether nothing so far tells the way along the direction that a match left open: odometry's
  // poses may be chance; or whether another way than theirs is the best so far.
  bool unsettled() const;
  const std::vector<StartScan>& scans() const { return scans_.all(); }
  const MatchResult& match() const { return match_; }
  // Frees what it holds.
  void Clear();
  // As before the first scan. What it follows is forgotten if it has closed since.
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
  // So many scans may speak against a way, so many are enough where they tell a steady motion, and
  // at the latest it is decided.
  static constexpr std::size_t kFewScans = 5, kManyScans = 8, kMostScans = 13;
  // Ways that nowhere differ by more are one.
  static constexpr double kSameWayM = 0.05;
  static bool SameWay(const std::vector<SE3>& a, const std::vector<SE3>& b);
  // A steady motion is a way if it differs from it by less ...
  static constexpr double kAgreesM = 0.15;
  // Two ways that are one may differ by as much, each being found to half of that.
  static constexpr double kAlikeM = 2.0 * kAgreesM;
  // ... and tells it if its speed is known so well: nothing is open any more.
  static constexpr double kKnownMS = 1.0;
  // One way is likelier than another, or makes it doubtful, by so many standard deviations.
  static constexpr double kLikelySigmas = 1.0, kDoubtedSigmas = 2.0;
  // In standard deviations by how much one is better.
  double Better(const Hypothesis& a, const Hypothesis& b) const;
  // SteadyMotionOptions::max_speed_m_s, by what the first scan sees.
  double MaxSpeedMS() const;
  // Of the change of velocity between the ways to a scan and to the one before it: what the motion
  // options allow, and what comes of three poses that are wrong by `pose_m`, one sigma each.
  double ChangeVariance(std::size_t scan, double pose_m) const;
  // U of a way.
  double Unsteadiness(const std::vector<SE3>& poses) const;
  // Whether U is what the motion options lead to expect.
  bool Steady(const std::vector<SE3>& poses) const;
  // Notes that a scan looks shaken, with that motion by odometry's poses.
  void Shake(std::size_t scan, const SweepMotion& sweep);
  // Poses that differ by moves along u, and fit better than those beside them.
  std::vector<SE3> Minima(const std::vector<PointCluster>& clusters, const SE3& T_world_lidar,
                          const VoxelMap& map, double middle_m, double reach_m) const;
  void Begin(const OdometryFrame& frame);
  // The newest scan under a hypothesis: where its motion leads, and in the minima beside that.
  std::vector<Hypothesis> Follow(const Hypothesis& hypothesis) const;
  // Brings its newest pose, of clusters deskewed, to the minimum near by; false if nothing fits.
  bool Match(const VoxelMap& map, const std::vector<PointCluster>& clusters,
             Hypothesis* hypothesis) const;
  // The same for the second scan, deskewed by the motion that the match finds.
  bool MatchSecond(Hypothesis* hypothesis) const;
  // Sorts the hypotheses, the best first, and drops what is refuted and what is another's double.
  void Rank();
  void Decide();
  // Odometry's way is the only one left: closes, or waits to be checked with all scans.
  void Trust();
  // Whether the sensor is so slow, by these poses, that it may be what goes along with it that
  // looks at rest: what is faster has left that behind.
  bool Slow(const std::vector<SE3>& poses) const;
  // Whether it also stands, or was at rest when it started, and has just set off.
  bool SettingOff(const std::vector<SE3>& poses) const;
  // Closes, if all scans together agree that the sensor set off like that, which is odometry's way
  // or the best hypothesis; or like odometry has it; or with the steady motion that they agree on
  // instead. Gives up if they do not, but once: what had set off moves by then, and what is at rest
  // still, among much that moves, stands.
  void CheckSettingOff(const std::vector<SE3>& poses);
  // Doubts odometry's way where a steady motion refutes it. The last scan closes: with that motion
  // in its place, or with odometry's way.
  void CheckGoingAlong(const std::vector<SE3>& own, bool last);
  // Closes with the best hypothesis. Where steady motions doubt one that is slow, more scans are
  // waited for, and the last closes with a motion that refutes it, or gives up.
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
  // Puts the scans where the steady motion has them under which they make the sharpest map: along
  // the direction that a match left open, and along that across the sensor's vertical axis which
  // the fewest planes face, as most sensors travel so. Where matches have turned scans of few
  // points wrongly, from no turn at all. False if it is no sharper than as odometry has them, or
  // says too little. Odometry's way is refuted where it is none of those they may have gone, or
  // another one is likelier, perhaps not known well enough yet.
  bool TakeSteady();
  // Closes with these poses, brought to the map of all others each, and the twists of `steady`.
  // Scans that find themselves far from it settle in rounds. False, and nothing changes, if one of
  // them meets too little, or if they come to lie on no way that a sensor takes.
  bool TakeSettled(std::vector<SE3> poses, const std::vector<SE3>& steady,
                   const Eigen::Vector3d& u);
  // Brings the pose of a scan to the map that all others make, along u only as far as few surfaces
  // may (direction_profile.h). False if it meets too little of it.
  bool SettleBeside(std::size_t scan, const Eigen::Vector3d& u, std::vector<SE3>* poses,
                    MatchResult* match) const;
  // Whether anything faces u: by poses that are right, the map that all others make has some blocks
  // of 4 m that do (DirectionProfile::Blocks), the mean over the scans.
  bool IsFaced(const Eigen::Vector3d& u, const std::vector<SE3>& poses, double least_blocks) const;
  // So many under a steady motion: in corridors and tunnels it is 0 to 0.8, in streets 5 to 15, of
  // few rays 1.1 and more. Under the best of several hypotheses, each of which fits as well as it
  // can where it is, rings in corridors make 2.5, and what stands among traffic 8 and more.
  static constexpr double kSteadyBlocks = 1.0, kBestBlocks = 4.0;
  // Whether the velocity changes at once by what no sensor does.
  bool Leaps(const std::vector<SE3>& poses) const;
  // Whether the second scan meets few planes of the first, and repeats few of its rays: rings that
  // go with the sensor agree on the ground, and best where it stands.
  bool ToldByBeams(const MatchResult& second) const;
  // Brings each pose to the map that all others make, in rounds; the match of the last.
  bool SettleAll(std::vector<SE3>* poses, MatchResult* match) const;
  // Whether the sensor stands by these poses, repeats its rays, and they end elsewhere each time.
  bool BeamsContradict(const std::vector<SE3>& poses) const;
  // Closes with the poses that beams agree on, where odometry's are refuted by them.
  bool TakeByBeams();
  // All but the first; the match of the last.
  bool SettleOthers(const Eigen::Vector3d& u, std::vector<SE3>* poses, MatchResult* match) const;
  // The steady motion along one direction, beside the way that poses have.
  struct SteadyAlong {
    std::vector<SE3> poses;  // under it
    Eigen::Vector3d along = Eigen::Vector3d::UnitX();
    double speed_m_s = 0.0;
    double open_speed_m_s = 0.0;  // infinite where it is not asked for
    double apart_m = 0.0;         // by which the two differ, at most
    double sharper = 0.0;         // by so many standard deviations; negative if the poses' way is
    bool told = false;            // known well enough to be one, as far as that is asked
    bool refutes = false;         // the poses' way, clearly
    bool refuted = false;         // rather, that way refutes all motions that are far from it
  };
  // Closes with that motion.
  bool TakeSettled(const SteadyAlong& steady) {
    return TakeSettled(steady.poses, steady.poses, steady.along);
  }
  // What is asked for, each taking longer than the one before: whether it refutes the poses' way,
  // and if so, all of it; all but what is left open of the speed unless it refutes them; all.
  enum class Asked { kIfRefutes, kOpenSpeedIfRefutes, kAll };
  SteadyAlong FindAlong(const std::vector<SE3>& from, const Eigen::Vector3d& u, double noise_m,
                        Asked asked) const;
  // The same along the direction that the fewest planes face.
  SteadyAlong FindAhead(const std::vector<SE3>& from, double noise_m,
                        Asked asked = Asked::kOpenSpeedIfRefutes) const;
  // By surfaces as sharp as the sensor's noise, and as sharp as decimetres: whether both say that
  // the poses' way is wrong, and agree on what it is instead.
  static bool Refute(const SteadyAlong& fine, const SteadyAlong& rough);
  // Whether the sensor has left behind, by these poses, what may have set off with it, or all scans
  // tell the two apart.
  bool Parted(const std::vector<SE3>& poses) const;
  // The same along one direction after the other.
  struct SteadyWay {
    std::vector<SE3> poses;   // moved where a steady motion that is told refutes them
    std::vector<SE3> moving;  // under the steady motions that are told
    bool moved = false;
    bool refuted = false;      // by motions of which none is told from the others
    bool doubted = false;      // a motion is likelier than poses that it neither refutes nor shares
    bool ahead_known = false;  // the speed along the first direction is told
    Eigen::Vector3d known = Eigen::Vector3d::Zero();  // the last direction whose speed is told
    double open_speed_m_s = 0.0;  // the largest that the motions by which they moved leave open
  };
  // How far the first and the last scan may be from where that puts them.
  double OpenM(const SteadyWay& way) const;
  SteadyWay FindSteady(const std::vector<SE3>& from,
                       const std::vector<Eigen::Vector3d>& directions) const;
  // Straight ahead, across the sensor's vertical axis, without a turn. False if that is not
  // likelier than the other way.
  bool FindStraight(const std::vector<SE3>& other, std::vector<SE3>* poses) const;
  // The scans as if the sensor had not moved along u, and how it has by these poses.
  std::vector<SteadyScan> WithoutWay(const std::vector<SE3>& poses, const Eigen::Vector3d& u,
                                     WayAlong* own) const;
  // Closes with these poses, and with the twists of those where it is `moving`.
  void Overrule(const std::vector<SE3>& poses, const std::vector<SE3>& moving,
                const MatchResult& match);

  ScanMatcher matcher_;
  double open_sigma_m_;
  SteadyMotionOptions steady_;
  State state_ = State::kOpen;
  bool unproven_ = false;        // after others, and no way is told
  bool after_given_up_ = false;  // after a start that was given up
  // What the scans so far are like.
  struct Seen {
    bool all_tracked = true, stamps_recorded = true;
    bool sparse = false;             // ToldByBeams
    bool shaken = false;             // some scan looked so
    std::size_t without_planes = 0;  // of so many planes do not tell the way
  };
  Seen seen_;
  // What speaks for odometry's way.
  enum class OwnWay : std::uint8_t {
    kHeld,        // matches leave nothing open
    kOpen,        // one left it open, by open_m_ at most, along open_along_
    kUnrivalled,  // of several ways it is left
  };
  OwnWay own_way_ = OwnWay::kHeld;
  // What speaks against it: many scans together. Then only all may tell another.
  bool refuted_ = false;
  double open_m_ = 0.0;
  Eigen::Vector3d open_along_ = Eigen::Vector3d::Zero();
  StartScans scans_;  // under the hypothesis that is left, once overruled
  std::vector<Hypothesis> hypotheses_;
  MatchResult match_;
  Eigen::Vector3d u_ = Eigen::Vector3d::UnitX();
};

}  // namespace lamina
