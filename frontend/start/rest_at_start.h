// A sensor that rests from the first scan on, or a few metres later, until it sets off.
//
// Where the rays of a sensor have the same directions in every scan, many scans from one place say
// no more than one: the map of them has the lines that few rays draw, which go with the sensor, and
// whatever is about to set off with it. Matched to that map, a pose is held where it was by a tenth
// of the way and more. So how such a sensor sets off is asked as if the recording began there
// (start_track.h), of the last scans at rest and those that follow.
//
// That it sets off shows in its rays before it shows in such poses. At rest they agree to a share A
// (resting_beams.h) that hardly changes, 0.88 to 0.93 in noise of 1 cm, with a standard deviation
// of 0.006. A step of 1.5 cm takes 0.02 to 0.07 from that, one of 4.5 cm 0.1 to 0.2. What passes by
// takes twice its share of the view.
#pragma once

#include <cstddef>
#include <utility>
#include <vector>

#include "core/base/angle.h"
#include "core/geometry/scan.h"
#include "core/geometry/se3.h"
#include "core/geometry/state_archive.h"
#include "frontend/odometry/odometry_frame.h"
#include "frontend/start/resting_beams.h"

namespace lamina {

// Not thread-safe; deterministic.
class RestAtStart {
 public:
  struct Kept {
    StampNs stamp_ns = 0;  // of the middle of its sweep
    bool stamp_made_up = false;
    std::vector<TimedCluster> clusters;

    void Archive(StateArchive& a) { a(&stamp_ns, &stamp_made_up, &clusters); }
  };

  // The next scan of a piece, from the first one on, as odometry has it, and how its rays agree
  // with those of the scan before. True once, if the sensor has rested and sets off with this scan.
  bool SetsOff(const OdometryFrame& frame, bool stamp_made_up,
               const std::vector<TimedCluster>& clusters, const RaysSeenAgain& rays);
  // The last scans before that, kKept of them, in their order.
  const std::vector<Kept>& kept() const { return kept_; }
  std::vector<Kept> TakeKept() { return std::exchange(kept_, {}); }
  // Whether it rests.
  bool rests() const { return !over_ && rested(); }
  // Whether no more is asked about: it has set off, or has come too far without a rest.
  bool over() const { return over_; }
  // It is not asked about any more.
  void End();
  // A start has ended. `rests`: all its scans are at rest; after such an alarm by rays, as of what
  // passes by, the next one takes twice as much. Otherwise it is over if the start was that of a
  // sensor that had set off.
  void GoOn(bool rests);
  // All poses move: T -> correction * T.
  void Move(const SE3& correction);

  // So far a sensor at rest may seem to move, of few points.
  static constexpr double kRestsM = 0.025, kRestsRad = Radians(0.4);
  // So far it may have come before it rests.
  static constexpr double kStartM = 5.0;

  // Between scans.
  void Archive(StateArchive& a);

 private:
  static constexpr std::size_t kKept = 2;
  static constexpr std::size_t kNewest = 5, kBlock = 64;
  static constexpr int kLeastRested = 4;
  bool rested() const { return rested_ >= kLeastRested; }
  // The scans at rest so far.
  void Forget();
  // A, at rest, of a pair of scans.
  void Agreed(double share);
  // The least of it, of one or two blocks of pairs, but for the newest ones.
  double LeastAgreed() const;

  bool over_ = false, begun_ = false;
  bool repeated_ = false;  // the rays of the last pair that was asked
  bool by_rays_ = false;   // it has set off by these, not by its poses
  int rested_ = 0;         // so many scans
  double less_ = 0.03;     // than the least: as of a sensor that moves
  std::vector<double> newest_agreed_;
  // Before these: of the block under way, which has so many pairs, and of the one before.
  double least_agreed_ = 1.0, least_before_ = 1.0;
  std::size_t in_block_ = 0;
  SE3 T_world_begin_, T_world_rest_;
  std::vector<Kept> kept_;
};

}  // namespace lamina
