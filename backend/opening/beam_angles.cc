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
  void Add(double angle_deg) {
    if (!std::isfinite(angle_deg)) return;  // of a point or a time that is none
    const double bin = (std::remainder(angle_deg, 360.0) + 180.0) / kBinDeg;
    ++counts_[static_cast<std::size_t>(std::clamp(bin, 0.0, kLast))];
  }
  // The probability that two angles are in one bin.
  double Concentration() const {
    double all = 0.0, squares = 0.0;
    for (const int count : counts_) {
      all += count;
      squares += static_cast<double>(count) * count;
    }
    return all > 0.0 ? squares / (all * all) : 0.0;
  }

 private:
  static constexpr double kBinDeg = 0.05;
  static constexpr std::size_t kBins = 7200;
  static constexpr double kLast = kBins - 1;
  std::vector<int> counts_ = std::vector<int>(kBins, 0);
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
  double Elevation() const { return elevation_.Concentration(); }
  double Azimuth() const {
    return std::max(clockwise_.Concentration(), counterclockwise_.Concentration());
  }

 private:
  double turn_s_;
  AngleHistogram elevation_, clockwise_, counterclockwise_;
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
  const TimeSpan span = SpanOfTimes(scan.time_s);
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

}  // namespace

BeamAngles BeamAnglesOf(const ScanSource& source, std::size_t begin, const Trajectory& poses) {
  constexpr int kScans = 6;
  const SensorTurn turn = SensorTurnOf(source, begin);
  const double turn_s = ShowsInAzimuths(turn, poses) ? turn.turn_s : 0.0;
  BeamConcentrations sums;
  int scans = 0;
  std::size_t k = 0;
  for (std::size_t i = begin; i < source.size() && scans < kScans && k < poses.size(); ++i) {
    if (source.Stamp(i) != poses[k].stamp_ns) continue;
    SweepMotion motion;
    if (!MotionThrough(poses, k++, SlidingWindow::kMaxTwistGapS, &motion)) continue;
    try {
      const Scan scan = source.Read(i);
      if (scan.points.empty() || scan.time_s.empty()) continue;
      AddScan(scan, motion, source.T_vehicle_lidar(i), turn_s, &sums);
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
