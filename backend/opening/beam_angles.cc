#include "backend/opening/beam_angles.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include "backend/window/sliding_window.h"
#include "core/base/angle.h"
#include "core/base/error.h"
#include "core/geometry/sweep_motion.h"

namespace lamina {
namespace {

// Angles counted in bins far narrower than beams are apart.
class AngleHistogram {
 public:
  explicit AngleHistogram(double bin_deg)
      : bin_deg_(bin_deg), counts_(static_cast<std::size_t>(std::lround(360.0 / bin_deg)), 0) {}

  void Add(double angle_deg) {
    if (!std::isfinite(angle_deg)) return;  // of a point or a time that is none
    const double bin = (std::remainder(angle_deg, 360.0) + 180.0) / bin_deg_;
    ++counts_[std::min(static_cast<std::size_t>(std::max(bin, 0.0)), counts_.size() - 1)];
  }
  // The probability that two angles are in one bin, or with `beside` in two side by side: where the
  // angle of a beam lies between two, as whole degrees do, rounding puts its points into either.
  double Concentration(bool beside) const {
    const double next_weight = beside ? 2.0 : 0.0;
    double all = 0.0, pairs = 0.0;
    for (std::size_t i = 0; i < counts_.size(); ++i) {
      const double here = counts_[i], next = counts_[(i + 1) % counts_.size()];
      all += here;
      pairs += here * (here + next_weight * next);
    }
    return all > 0.0 ? pairs / (all * all) : 0.0;
  }

 private:
  double bin_deg_;
  std::vector<int> counts_;
};

// Of points of one scan.
class BeamHistograms {
 public:
  // `turn_s`: of the sensor; 0 where that is not known.
  explicit BeamHistograms(double turn_s) : turn_s_(turn_s) {}

  void Add(const Eigen::Vector3d& point, double time_s) {
    elevation_.Add(Degrees(std::atan2(point.z(), point.head<2>().norm())));
    if (turn_s_ <= 0.0) return;
    const double azimuth = Degrees(std::atan2(point.y(), point.x()));
    clockwise_.Add(azimuth + 360.0 * time_s / turn_s_);
    counterclockwise_.Add(azimuth - 360.0 * time_s / turn_s_);
  }
  double Elevation() const { return elevation_.Concentration(true); }
  double Azimuth() const {
    return std::max(clockwise_.Concentration(false), counterclockwise_.Concentration(false));
  }

 private:
  // Azimuths are as sharp as the times of points are, and lie anywhere.
  static constexpr double kElevationBinDeg = 0.025, kAzimuthBinDeg = 0.05;

  double turn_s_;
  AngleHistogram elevation_{kElevationBinDeg};
  AngleHistogram clockwise_{kAzimuthBinDeg}, counterclockwise_{kAzimuthBinDeg};
};

// To which moment points may have been moved: the first of a sweep, the middle, the last, the
// stamp.
constexpr std::size_t kMoments = 4;

// Sums over scans.
struct Concentrations {
  double as_they_are = 0.0;
  std::array<double, kMoments> taken_back{};

  // Where no beams are, both are as sharp; of spinning sensors at 1 to 28 m/s one is, by 1.5 to 17
  // times.
  BeamAngles Tell() const {
    constexpr double kClearlySharper = 1.5;
    const double back = *std::max_element(taken_back.begin(), taken_back.end());
    if (as_they_are > kClearlySharper * back) return BeamAngles::kAsMeasured;
    if (back > kClearlySharper * as_they_are) return BeamAngles::kCompensated;
    return BeamAngles::kUnknown;
  }
};
struct BeamConcentrations {
  Concentrations elevation, azimuth;
};

// Adds those of one scan during which the sensor moved so.
void AddScan(const Scan& scan, const SweepMotion& motion, const SE3& T_vehicle_lidar, double turn_s,
             BeamConcentrations* sums) {
  constexpr std::size_t kMostPoints = 20000;
  constexpr double kLeastRangeM = 2.0;
  const TimeSpan span = UsualSpanOfTimes(scan.time_s);
  const std::array<SE3, kMoments> T_stamp_moment{motion.PoseAt(span.low_s),
                                                 motion.PoseAt(0.5 * (span.low_s + span.high_s)),
                                                 motion.PoseAt(span.high_s), SE3()};
  BeamHistograms as_they_are(turn_s);
  std::vector<BeamHistograms> taken_back(kMoments, as_they_are);
  const SE3 T_lidar_vehicle = T_vehicle_lidar.Inverse();
  for (std::size_t i = 0; i < scan.points.size(); i += 1 + scan.points.size() / kMostPoints) {
    const ScanPoint& p = scan.points[i];
    const Eigen::Vector3d point = Eigen::Vector3f(p.x, p.y, p.z).cast<double>();
    if (!(point.norm() >= kLeastRangeM) || !std::isfinite(scan.time_s[i])) continue;
    const auto time_s = static_cast<double>(scan.time_s[i]);
    as_they_are.Add(point, time_s);
    const SE3 T_time_stamp = motion.PoseAt(time_s).Inverse();
    for (std::size_t m = 0; m < kMoments; ++m) {
      const SE3 T_time_moment = T_time_stamp * T_stamp_moment[m];
      taken_back[m].Add(T_lidar_vehicle * (T_time_moment * (T_vehicle_lidar * point)), time_s);
    }
  }
  sums->elevation.as_they_are += as_they_are.Elevation();
  sums->azimuth.as_they_are += as_they_are.Azimuth();
  for (std::size_t m = 0; m < kMoments; ++m) {
    sums->elevation.taken_back[m] += taken_back[m].Elevation();
    sums->azimuth.taken_back[m] += taken_back[m].Azimuth();
  }
}

// By the stamps from scan `begin` on: how long a turn of the sensor takes, and by how much that
// may be wrong. Nothing where they are not so regular.
struct SensorTurn {
  double turn_s = 0.0, error_s = 0.0;
};
SensorTurn SensorTurnOf(const ScanSource& source, std::size_t begin) {
  constexpr std::size_t kScans = 20, kFewest = 5;
  constexpr double kRegular = 0.2;
  if (!source.recorded_stamps()) return {};
  std::vector<double> stamps_s;
  for (std::size_t i = begin; i < source.size() && stamps_s.size() < kScans; ++i) {
    if (source.Sensor(i) == source.Sensor(begin))
      stamps_s.push_back(SecondsBetween(source.Stamp(begin), source.Stamp(i)));
  }
  if (stamps_s.size() < kFewest) return {};
  const auto gaps = static_cast<double>(stamps_s.size() - 1);
  const double turn_s = stamps_s.back() / gaps;
  double worst_s = 0.0;
  for (std::size_t i = 0; i < stamps_s.size(); ++i)
    worst_s = std::max(worst_s, std::abs(stamps_s[i] - static_cast<double>(i) * turn_s));
  if (!(turn_s > 0.0) || worst_s > kRegular * turn_s) return {};
  return {turn_s, 2.0 * worst_s / gaps};
}

// Whether the sensor turns so much in a sweep that no error of its own turn can look like that.
bool ShowsInAzimuths(const SensorTurn& turn, const Trajectory& poses) {
  constexpr double kLeastDeg = 0.5, kTimesError = 4.0;
  double turned_rad = 0.0;
  for (std::size_t k = 1; k < poses.size(); ++k)
    turned_rad =
        std::max(turned_rad, RotationAngle(poses[k - 1].T_world_lidar, poses[k].T_world_lidar));
  const double turned_deg = Degrees(turned_rad);
  return turn.turn_s > 0.0 && turned_deg > kLeastDeg &&
         turned_deg > kTimesError * 360.0 * turn.error_s / turn.turn_s;
}

// A scan of a source, and how the sensor moved during it.
struct MovedScan {
  std::size_t scan = 0;
  SweepMotion motion;

  // Of a point at a usual distance, m/s.
  double Speed() const {
    constexpr double kDistanceM = 10.0;
    return kDistanceM * motion.twist.head<3>().norm() + motion.twist.tail<3>().norm();
  }
};

// Those that poses tell the motion of, the fastest first: of a sensor that stands nothing tells
// whether its scans are compensated.
std::vector<MovedScan> MostMoved(const ScanSource& source, std::size_t begin,
                                 const Trajectory& poses) {
  std::vector<MovedScan> scans;
  std::size_t k = 0;
  for (std::size_t i = begin; i < source.size() && k < poses.size(); ++i) {
    if (source.Stamp(i) != poses[k].stamp_ns) continue;
    MovedScan moved{i, {}};
    if (MotionThrough(poses, k++, SlidingWindow::kMaxTwistGapS, &moved.motion))
      scans.push_back(moved);
  }
  std::stable_sort(scans.begin(), scans.end(),
                   [](const MovedScan& a, const MovedScan& b) { return a.Speed() > b.Speed(); });
  return scans;
}

}  // namespace

BeamAngles BeamAnglesOf(const ScanSource& source, std::size_t begin, const Trajectory& poses) {
  constexpr std::size_t kScans = 6;
  const SensorTurn turn = SensorTurnOf(source, begin);
  const double turn_s = ShowsInAzimuths(turn, poses) ? turn.turn_s : 0.0;
  BeamConcentrations sums;
  std::size_t scans = 0;
  for (const MovedScan& moved : MostMoved(source, begin, poses)) {
    if (scans >= kScans) break;
    try {
      const Scan scan = source.Read(moved.scan);
      if (scan.points.empty() || scan.time_s.empty()) continue;
      AddScan(scan, moved.motion, source.T_vehicle_lidar(moved.scan), turn_s, &sums);
      ++scans;
    } catch (const InputError&) {
      // The next one may be readable.
    }
  }
  const BeamAngles by_elevation = sums.elevation.Tell(), by_azimuth = sums.azimuth.Tell();
  if (by_elevation == BeamAngles::kCompensated) return by_elevation;
  if (by_azimuth == BeamAngles::kAsMeasured) return BeamAngles::kAsMeasuredAtTheirTimes;
  return by_elevation == BeamAngles::kUnknown ? by_azimuth : by_elevation;
}

}  // namespace lamina
