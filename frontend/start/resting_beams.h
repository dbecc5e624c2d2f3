// Whether a sensor that seems to rest sees again what it saw.
//
// A sensor whose rays have the same directions in every scan finds its own lines wherever it is:
// the rings on the ground, the columns on walls along the way. Where these are most of what it
// sees, as with a few thousand rays, a map of them holds the pose where the sensor was. Rays that
// are repeated from one place end where they ended before; from another place those on the ground
// and along the way do so, and the others do not (beam_agreement.h). Repeated at rest they agree to
// 0.9 in noise of 1 cm and to 0.5 in noise of 5 cm, without what has moved meanwhile; where the
// sensor has moved by 4 cm to 0.55. Of 2000 to 5000 rays from a vehicle that drives it is 0.2 to
// 0.5, and less than 0.4 where the pose creeps. In noise that is larger than it is known to be they
// agree as little, but then all do alike.
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

  // Two scans, undeskewed, and the later one's pose in the frame of the other. Left out where the
  // sensor has moved by 4 cm or turned by 0.2 deg: rays that go on by so much end elsewhere anyway.
  void Add(const std::vector<PointCluster>& before, const std::vector<PointCluster>& clusters,
           const SE3& T_before_this);
  std::size_t pairs() const { return pairs_.size(); }
  // Whether most rays are repeated.
  bool Repeated() const;
  // Whether they are, and all but few of them end where they did, as far as noise goes.
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
  // The newest scan is here after all.
  void MoveTo(const SE3& T_world_lidar) { T_world_last_ = T_world_lidar; }
  // The newest scan and the one before, if both are those of a sensor at rest.
  const RaysSeenAgain& newest() const { return newest_; }
  // Whether the sensor rests by the newest two poses and its rays contradict, or have done so a
  // short while ago: until rays agree, as long as it is slow.
  bool Contradict() const { return doubted_ > 0; }
  // So many scans whose rays contradict are not followed by one whose rays agree.
  int contradictions() const { return contradictions_; }

  // Between scans; but for newest().
  void Archive(StateArchive& a) { a(&last_, &T_world_last_, &contradictions_, &doubted_); }

 private:
  double noise_m_;
  RaysSeenAgain newest_;
  std::vector<PointCluster> last_;  // empty where there is none
  SE3 T_world_last_;
  int contradictions_ = 0;
  int doubted_ = 0;  // so many scans more are doubted
};

}  // namespace lamina
