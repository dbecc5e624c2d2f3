// A sensor that rests from the first scan on, or a few metres later, until it sets off.
//
// If the rays of a sensor have the same directions in every scan, many scans from one place add no
// information to one: their map contains the lines that few rays draw, which move along with the
// sensor, and whatever is about to start together with it. A scan matched to that map is biased
// towards the rest position by a tenth of the distance moved, or more. So the first motion of such
// a sensor is estimated as if the recording began there (start_track.h), from the last scans at
// rest and those that follow.
//
// Ranges show the motion before such poses do. At rest they agree to a share A (resting_beams.h)
// that hardly changes, 0.88 to 0.93 in noise of 1 cm, with a standard deviation of 0.006. A step of
// 1.5 cm lowers A by 0.02 to 0.07, one of 4.5 cm by 0.1 to 0.2. Passing traffic lowers it by twice
// its share of the view.
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

  // The next scan of a piece, from the first one on: its frame from odometry, and how its rays
  // agree with those of the scan before. True once: if the sensor has rested and this scan shows
  // motion.
  bool SetsOff(const OdometryFrame& frame, bool stamp_made_up,
               const std::vector<TimedCluster>& clusters, const RaysSeenAgain& rays);
  // The last scans at rest, kKept of them, the oldest first.
  const std::vector<Kept>& kept() const { return kept_; }
  std::vector<Kept> TakeKept() { return std::exchange(kept_, {}); }
  // Whether the sensor is at rest.
  bool rests() const { return !over_ && rested(); }
  // Whether detection has ended: the sensor has set off, was lost, or came too far without a rest.
  bool over() const { return over_; }
  // Ends detection.
  void End();
  // A start has ended. `rests`: all its scans are at rest, and detection begins anew; if the alarm
  // was raised by ranges and so proved false (passing traffic), the threshold for the next one
  // doubles. Otherwise detection ends if the start was one that an alarm had begun.
  void GoOn(bool rests);
  // All poses move: T -> correction * T.
  void Move(const SE3& correction);

  // Pose jitter of a resting sensor with few points per scan.
  static constexpr double kRestsM = 0.025, kRestsRad = Radians(0.4);
  // A sensor that comes farther than this from its first pose is not expected to rest at the start.
  static constexpr double kStartM = 5.0;

  // Between scans.
  void Archive(StateArchive& a);

 private:
  static constexpr std::size_t kKept = 2;
  static constexpr std::size_t kNewest = 5, kBlock = 64;
  static constexpr int kLeastRested = 4;
  bool rested() const { return rested_ >= kLeastRested; }
  // Forgets the scans at rest so far.
  void Forget();
  // Records A of a pair of scans at rest.
  void Agreed(double share);
  // The smallest A of the last one to two blocks of pairs, without the newest ones.
  double LeastAgreed() const;

  bool over_ = false, begun_ = false;
  bool repeated_ = false;  // whether the rays of the last pair of scans repeat
  bool by_rays_ = false;   // the alarm was raised by ranges, not by poses
  int rested_ = 0;         // number of scans at rest
  double less_ = 0.03;     // drop of A below its recent minimum that indicates motion
  std::vector<double> newest_agreed_;
  // The smallest A, before these, of the present block, which has in_block_ pairs, and of the
  // previous one.
  double least_agreed_ = 1.0, least_before_ = 1.0;
  std::size_t in_block_ = 0;
  SE3 T_world_begin_, T_world_rest_;
  std::vector<Kept> kept_;
};

}  // namespace lamina
