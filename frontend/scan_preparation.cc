#include "frontend/scan_preparation.h"

#include <algorithm>
#include <cmath>

#include "core/base/median.h"

namespace lamina {
namespace {

constexpr float kPi = 3.14159265358979F;

// Sensors turn 5 to 20 times a second: scans farther apart were picked from more.
constexpr double kLongestSweepS = 0.22;

// atan2 to 1e-5 rad, several times faster than the library's: 1e-5 of a sweep's turn is well below
// a micrometre of motion.
inline float FastAtan2(float y, float x) {
  const float ax = std::abs(x);
  const float ay = std::abs(y);
  const float big = std::max(ax, ay);
  const float a = big > 0.0F ? std::min(ax, ay) / big : 0.0F;
  const float s = a * a;
  // Minimax polynomial of atan on [0, 1], odd terms up to the 11th.
  float r =
      a * (0.99997726F +
           s * (-0.33262347F +
                s * (0.19354346F + s * (-0.11643287F + s * (0.05265332F - s * 0.01172120F)))));
  if (ay > ax) r = 0.5F * kPi - r;
  if (x < 0.0F) r = kPi - r;
  return y < 0.0F ? -r : r;
}

// Time of a point from its azimuth.
class AzimuthClock {
 public:
  AzimuthClock(const ScanPreparationOptions& options, double period_s)
      : sign_(options.rotation == ScanPreparationOptions::Rotation::kClockwise ? -1.0F : 1.0F),
        start_(static_cast<float>(options.sweep_start_azimuth_deg) * kPi / 180.0F),
        stamp_fraction_(static_cast<float>(options.stamp_at_sweep_fraction)),
        period_(static_cast<float>(period_s)) {}

  float TimeOf(float x, float y) const {
    float turn = sign_ * (FastAtan2(y, x) - start_) / (2.0F * kPi);
    turn -= std::floor(turn);
    return (turn - stamp_fraction_) * period_;
  }

 private:
  float sign_, start_, stamp_fraction_, period_;
};

void MoveInto(const SE3& T_vehicle_lidar, std::vector<TimedPoint>* points) {
  const Eigen::Matrix3f R = T_vehicle_lidar.R().cast<float>();
  const Eigen::Vector3f t = T_vehicle_lidar.t.cast<float>();
  if (R == Eigen::Matrix3f::Identity() && t.isZero(0.0F)) return;
  for (TimedPoint& p : *points) {
    const Eigen::Vector3f moved = R * Eigen::Vector3f(p.x, p.y, p.z) + t;
    p = {moved.x(), moved.y(), moved.z(), p.time_s};
  }
}

}  // namespace

void ScanPreparationOptions::Visit(OptionVisitor& v) {
  v.Number("min_range_m", &min_range_m, 0.0, 1000.0);
  v.Number("max_range_m", &max_range_m, 0.1, 10000.0);
  v.Number("vertical_correction_deg", &vertical_correction_deg, -5.0, 5.0);
  v.Number("range_offset_m", &range_offset_m, -1.0, 1.0);
  v.EnumChoice("deskew", &deskew, {"off", "time", "azimuth", "auto"});
  v.EnumChoice("rotation", &rotation, {"clockwise", "counterclockwise"});
  v.Number("sweep_start_azimuth_deg", &sweep_start_azimuth_deg, -360.0, 360.0);
  v.Number("stamp_at_sweep_fraction", &stamp_at_sweep_fraction, 0.0, 1.0);
  v.Number("sweep_period_s", &sweep_period_s, 0.0, 10.0);
}

PreparedScan PrepareScan(const Scan& scan, const ScanPreparationOptions& options,
                         double sweep_period_s, const SE3& T_vehicle_lidar) {
  using Deskew = ScanPreparationOptions::Deskew;
  const bool from_azimuth = options.deskew == Deskew::kAzimuth;
  const bool from_file =
      !scan.time_s.empty() && (options.deskew == Deskew::kTime || options.deskew == Deskew::kAuto);
  const AzimuthClock clock(options,
                           options.sweep_period_s > 0.0 ? options.sweep_period_s : sweep_period_s);
  const auto min2 = static_cast<float>(options.min_range_m * options.min_range_m);
  const auto max2 = static_cast<float>(options.max_range_m * options.max_range_m);
  const double correction = options.vertical_correction_deg * M_PI / 180.0;
  const auto sine = static_cast<float>(std::sin(correction));
  const auto cosine = static_cast<float>(std::cos(correction));
  const auto range_offset = static_cast<float>(options.range_offset_m);

  PreparedScan result;
  result.points.resize(scan.points.size());
  size_t kept = 0;
  for (size_t i = 0; i < scan.points.size(); ++i) {
    const ScanPoint& raw = scan.points[i];
    const float flat2 = raw.x * raw.x + raw.y * raw.y;
    const float range2 = flat2 + raw.z * raw.z;
    if (!std::isfinite(range2)) {
      // A finite point may overflow when squared; it is then merely far away.
      const bool finite = std::isfinite(raw.x) && std::isfinite(raw.y) && std::isfinite(raw.z);
      ++(finite ? result.out_of_range : result.non_finite);
      continue;
    }
    if (range2 < min2 || range2 > max2) {
      ++result.out_of_range;
      continue;
    }
    TimedPoint& p = result.points[kept];
    p = {raw.x, raw.y, raw.z, 0.0F};
    if (from_azimuth) p.time_s = clock.TimeOf(raw.x, raw.y);
    if (from_file) {
      p.time_s = scan.time_s[i];
      if (!std::isfinite(p.time_s)) {
        ++result.non_finite;
        continue;
      }
    }
    if (sine != 0.0F && flat2 > 0.0F) {
      // p cos + (a x p) sin with the unit axis a = (p x z) / |p x z|.
      const float flat = std::sqrt(flat2);
      const float k = cosine - sine * raw.z / flat;
      p.x *= k;
      p.y *= k;
      p.z = cosine * raw.z + sine * flat;
    }
    if (range_offset != 0.0F && range2 > 0.0F) {
      // Not below zero: no point changes sides.
      const float k = std::max(0.0F, 1.0F + range_offset / std::sqrt(range2));
      p.x *= k;
      p.y *= k;
      p.z *= k;
    }
    ++kept;
  }
  result.points.resize(kept);
  MoveInto(T_vehicle_lidar, &result.points);
  return result;
}

double SweepPeriod(const std::vector<StampNs>& stamps_up_to_i, double fallback_s) {
  constexpr size_t kMost = 9;
  std::vector<double> periods;
  for (size_t i = stamps_up_to_i.size(); i-- > 1 && periods.size() < kMost;) {
    const double period = SecondsBetween(stamps_up_to_i[i - 1], stamps_up_to_i[i]);
    if (period > 0.0) periods.push_back(period);
  }
  if (periods.empty()) return fallback_s;
  const double period_s = UpperMedian(&periods);
  return period_s <= kLongestSweepS ? period_s : fallback_s;
}

}  // namespace lamina
