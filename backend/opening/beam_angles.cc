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

// Elevations counted in bins far narrower than beams are apart.
class ElevationHistogram {
 public:
  void Add(const Eigen::Vector3d& point) {
    const double elevation_deg = Degrees(std::atan2(point.z(), point.head<2>().norm()));
    if (!std::isfinite(elevation_deg)) return;  // of a point or a time that is none
    ++counts_[static_cast<std::size_t>(std::clamp((elevation_deg + 90.0) / kBinDeg, 0.0, kLast))];
  }
  // The probability that two points are in one bin.
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
  static constexpr std::size_t kBins = 3600;
  static constexpr double kLast = kBins - 1;
  std::vector<int> counts_ = std::vector<int>(kBins, 0);
};

// To which moment points may have been moved: the first of a sweep, the middle, the last, the
// stamp.
constexpr std::size_t kMoments = 4;

struct Concentrations {
  double as_they_are = 0.0;
  std::array<double, kMoments> taken_back{};
};

// Adds those of one scan during which the sensor moved so.
void AddScan(const Scan& scan, const SweepMotion& motion, const SE3& T_vehicle_lidar,
             Concentrations* sums) {
  constexpr std::size_t kMostPoints = 20000;
  constexpr double kLeastRangeM = 2.0;
  const TimeSpan span = SpanOfTimes(scan.time_s);
  const std::array<SE3, kMoments> T_stamp_moment{motion.PoseAt(span.low_s),
                                                 motion.PoseAt(0.5 * (span.low_s + span.high_s)),
                                                 motion.PoseAt(span.high_s), SE3()};
  ElevationHistogram as_they_are;
  std::array<ElevationHistogram, kMoments> taken_back;
  const SE3 T_lidar_vehicle = T_vehicle_lidar.Inverse();
  for (std::size_t i = 0; i < scan.points.size(); i += 1 + scan.points.size() / kMostPoints) {
    const ScanPoint& p = scan.points[i];
    const Eigen::Vector3d point = Eigen::Vector3f(p.x, p.y, p.z).cast<double>();
    if (!(point.norm() >= kLeastRangeM) || !std::isfinite(scan.time_s[i])) continue;
    as_they_are.Add(point);
    const SE3 T_time_stamp = motion.PoseAt(static_cast<double>(scan.time_s[i])).Inverse();
    for (std::size_t m = 0; m < kMoments; ++m) {
      const SE3 T_time_moment = T_time_stamp * T_stamp_moment[m];
      taken_back[m].Add(T_lidar_vehicle * (T_time_moment * (T_vehicle_lidar * point)));
    }
  }
  sums->as_they_are += as_they_are.Concentration();
  for (std::size_t m = 0; m < kMoments; ++m) sums->taken_back[m] += taken_back[m].Concentration();
}

}  // namespace

BeamAngles BeamAnglesOf(const ScanSource& source, std::size_t begin, const Trajectory& poses) {
  constexpr int kScans = 6;
  // Where no beams are, both are as sharp; of spinning sensors at 1 to 28 m/s one is, by 1.5 to 17
  // times.
  constexpr double kClearlySharper = 1.5;
  Concentrations sums;
  int scans = 0;
  std::size_t k = 0;
  for (std::size_t i = begin; i < source.size() && scans < kScans && k < poses.size(); ++i) {
    if (source.Stamp(i) != poses[k].stamp_ns) continue;
    SweepMotion motion;
    if (!MotionThrough(poses, k++, SlidingWindow::kMaxTwistGapS, &motion)) continue;
    try {
      const Scan scan = source.Read(i);
      if (scan.points.empty() || scan.time_s.empty()) continue;
      AddScan(scan, motion, source.T_vehicle_lidar(i), &sums);
      ++scans;
    } catch (const InputError&) {
      // The next one may be readable.
    }
  }
  const double taken_back = *std::max_element(sums.taken_back.begin(), sums.taken_back.end());
  if (sums.as_they_are > kClearlySharper * taken_back) return BeamAngles::kAsMeasured;
  if (taken_back > kClearlySharper * sums.as_they_are) return BeamAngles::kCompensated;
  return BeamAngles::kUnknown;
}

}  // namespace lamina
