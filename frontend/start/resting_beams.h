// Whether the ranges of a sensor that seems to rest are those that it measured before.
//
// If the rays of a sensor have the same directions in every scan, its own lines (rings on the
// ground, columns on walls along the way) match wherever it is. Where these are most of a scan, as
// with a few thousand rays, a match to their map leaves the pose where the sensor was. Rays
// repeated from one place end where they ended before; after a motion those on the ground and along
// the way still do, the others do not (beam_agreement.h). Repeated at rest they agree to 0.9 in
// noise of 1 cm and to 0.5 in noise of 5 cm, without what has moved meanwhile; after a motion of 4
// cm to 0.55. Of 2000 to 5000 rays of a driving vehicle it is 0.2 to 0.5, and less than 0.4 where
// the pose creeps. If the noise is larger than the option says they agree as little, but then all
// rays alike.
#pragma once

#include <cstddef>
#include <vector>

#include "core/geometry/point_cluster.h"
#include "core/geometry/scan.h"
#include "core/geometry/se3.h"
#include "core/geometry/state_archive.h"

namespace lamina {

// Sums over pairs of scans that follow one another.
class RaysSeenAgain {
 public:
  // `noise_m`: of ranges.
  explicit RaysSeenAgain(double noise_m) : noise_m_(noise_m) {}

  // Two scans, undeskewed, and the later one's pose in the frame of the other. Ignored if the
  // sensor has moved by 4 cm or turned by 0.2 deg: rays of another place end elsewhere anyway.
  void Add(const std::vector<PointCluster>& before, const std::vector<PointCluster>& clusters,
           const SE3& T_before_this);
  std::size_t pairs() const { return pairs_.size(); }
  // Whether most rays are repeated.
  bool Repeated() const;
  // Whether most rays are repeated and all but few end where they did, within the noise that they
  // show.
  bool Rests() const;
  // How well they agree, in [0, 1]; of at least one pair.
  double Agree() const;
  // Whether rays are repeated, and do not end where they did.
  bool Contradict() const;

 private:
  struct Pair {
    double repeated = 0.0;  // share of the rays
    double agree = 0.0;     // how well they agree
    double least = 0.0;     // that, of rays that do not contradict
    double in_noise = 0.0;  // how well they agree in the noise that they show, at least `agree`
  };
  // Of at least one pair.
  template <typename Of>
  double Mean(const Of& of) const;

  double noise_m_;
  std::vector<Pair> pairs_;
};

// The newest scan of a sensor, as long as it moves slowly. Not thread-safe.
class RestingBeams {
 public:
  explicit RestingBeams(double noise_m) : noise_m_(noise_m), newest_(noise_m) {}

  // The next scan at its pose.
  void Add(const std::vector<TimedCluster>& clusters, const SE3& T_world_lidar);
  // Replaces the pose of the newest scan after it was re-estimated.
  void MoveTo(const SE3& T_world_lidar) { T_world_last_ = T_world_lidar; }
  // Agreement of the newest scan with the one before; without a pair unless both are at rest.
  const RaysSeenAgain& newest() const { return newest_; }
  // Whether the sensor rests by its newest two poses and the ranges contradict that, or did so
  // within the last ten scans at low speed; ranges that agree end the doubt.
  bool Contradict() const { return doubted_ > 0; }
  // Number of scans whose ranges contradict, since ranges last agreed.
  int contradictions() const { return contradictions_; }

  // Between scans; but for newest().
  void Archive(StateArchive& a) { a(&last_, &T_world_last_, &contradictions_, &doubted_); }

 private:
  double noise_m_;
  RaysSeenAgain newest_;
  std::vector<PointCluster> last_;  // empty where there is none
  SE3 T_world_last_;
  int contradictions_ = 0;
  int doubted_ = 0;  // number of further scans that stay doubted
};

}  // namespace lamina
