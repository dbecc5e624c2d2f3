#include "frontend/scan/scan_preparation.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <sstream>

#include "core/base/angle.h"
#include "core/base/median.h"
#include "core/base/processor.h"

namespace lamina {
namespace {

constexpr float kPi = 3.14159265358979F;

// Sensors turn 5 to 20 times a second: scans farther apart were picked from more.
constexpr double kLongestSweepS = 0.22;

// Points of a part of a scan, an array for each coordinate: loops over them are compiled to
// instructions that take several points at once.
struct PointColumns {
  static constexpr std::size_t kMost = 256;
  std::size_t count = 0;
  float x[kMost], y[kMost], z[kMost];
  float flat2[kMost], range2[kMost];  // from the vertical axis and from the origin, as filtered
  float time_s[kMost];
};

// atan2 to 1e-5 rad, several times faster than the library's: 1e-5 of a sweep's turn is well below
// a micrometre of motion.
inline float FastAtan2(float y, float x) {
  const float ax = std::abs(x);
  const float ay = std::abs(y);
  const float big = std::max(ax, ay);
  const float ratio = std::min(ax, ay) / big;
  const float a = big > 0.0F ? ratio : 0.0F;
  const float s = a * a;
  // Minimax polynomial of atan on [0, 1], odd terms up to the 11th.
  float r =
      a * (0.99997726F +
           s * (-0.33262347F +
                s * (0.19354346F + s * (-0.11643287F + s * (0.05265332F - s * 0.01172120F)))));
  r = ay > ax ? 0.5F * kPi - r : r;
  r = x < 0.0F ? kPi - r : r;
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

  void SetTimes(PointColumns* points) const;

 private:
  float sign_, start_, stamp_fraction_, period_;
};

LAMINA_FOR_EACH_PROCESSOR
void AzimuthClock::SetTimes(PointColumns* points) const {
  const float sign = sign_, start = start_, stamp_fraction = stamp_fraction_, period = period_;
  for (std::size_t i = 0; i < points->count; ++i) {
    const float turn = sign * (FastAtan2(points->y[i], points->x[i]) - start) / (2.0F * kPi);
    // Two turns at most from zero: floor() by way of an integer, which every processor can.
    const auto whole = static_cast<float>(static_cast<int>(turn));
    const float fraction = turn - (whole > turn ? whole - 1.0F : whole);
    points->time_s[i] = (fraction - stamp_fraction) * period;
  }
}

void CorrectBeams(const BeamTable& beams, PointColumns* points) {
  beams.Correct(points->count, points->x, points->y, points->z);
  for (std::size_t i = 0; i < points->count; ++i) {
    points->flat2[i] = points->x[i] * points->x[i] + points->y[i] * points->y[i];
    points->range2[i] = points->flat2[i] + points->z[i] * points->z[i];
  }
}

// p cos + (a x p) sin with the unit axis a = (p x z) / |p x z|.
LAMINA_FOR_EACH_PROCESSOR
void TurnUp(float sine, float cosine, PointColumns* points) {
  for (std::size_t i = 0; i < points->count; ++i) {
    const float flat = std::sqrt(points->flat2[i]), z = points->z[i];
    const float turned = cosine - sine * z / flat;
    const float k = flat > 0.0F ? turned : 1.0F;
    points->x[i] *= k;
    points->y[i] *= k;
    points->z[i] = flat > 0.0F ? cosine * z + sine * flat : z;
  }
}

LAMINA_FOR_EACH_PROCESSOR
void LengthenRays(float by_m, PointColumns* points) {
  for (std::size_t i = 0; i < points->count; ++i) {
    // Not below zero: no point changes sides.
    const float longer = std::max(0.0F, 1.0F + by_m / std::sqrt(points->range2[i]));
    const float k = points->range2[i] > 0.0F ? longer : 1.0F;
    points->x[i] *= k;
    points->y[i] *= k;
    points->z[i] *= k;
  }
}

// Takes points from *next on, until the columns are full, and counts those that it drops.
class PointFilter {
 public:
  // `times`: those that points may have, if they have times.
  PointFilter(const ScanPreparationOptions& options, const std::optional<TimeSpan>& times)
      : min2_(static_cast<float>(options.min_range_m * options.min_range_m)),
        max2_(static_cast<float>(options.max_range_m * options.max_range_m)),
        timed_(times.has_value()),
        earliest_s_(times ? static_cast<float>(times->low_s) : 0.0F),
        latest_s_(times ? static_cast<float>(times->high_s) : 0.0F) {}

  void Take(const Scan& scan, std::size_t* next, PointColumns* points, PreparedScan* result) const {
    points->count = 0;
    std::size_t i = *next;
    while (i < scan.points.size() && points->count + kTogether <= PointColumns::kMost) {
      if (i + kTogether <= scan.points.size() && TakeTogether(scan, i, points)) {
        points->count += kTogether;
        i += kTogether;
        continue;
      }
      const std::size_t end = std::min(i + kTogether, scan.points.size());
      for (; i < end; ++i) TakeOne(scan, i, points, result);
    }
    *next = i;
  }

 private:
  // Points that are read at once; of nearly all of them none is dropped.
  static constexpr std::size_t kTogether = 16;
  static_assert(PointColumns::kMost % kTogether == 0);

  // Reads points from i on behind those that the columns count. False if one is to be dropped.
  bool TakeTogether(const Scan& scan, std::size_t i, PointColumns* points) const;
  void TakeOne(const Scan& scan, std::size_t i, PointColumns* points, PreparedScan* result) const {
    const ScanPoint& raw = scan.points[i];
    const float flat2 = raw.x * raw.x + raw.y * raw.y;
    const float range2 = flat2 + raw.z * raw.z;
    const float time_s = timed_ ? scan.time_s[i] : 0.0F;
    if (!(range2 >= min2_ && range2 <= max2_)) {
      // A finite point may overflow when squared; it is then merely far away.
      const bool finite = std::isfinite(raw.x) && std::isfinite(raw.y) && std::isfinite(raw.z);
      ++(finite ? result->out_of_range : result->non_finite);
      return;
    }
    if (timed_ && !(time_s >= earliest_s_ && time_s <= latest_s_)) {
      ++result->out_of_time;
      return;
    }
    const std::size_t place = points->count++;
    points->x[place] = raw.x;
    points->y[place] = raw.y;
    points->z[place] = raw.z;
    points->flat2[place] = flat2;
    points->range2[place] = range2;
    points->time_s[place] = time_s;
  }

  float min2_, max2_;
  bool timed_;
  float earliest_s_, latest_s_;
};

LAMINA_FOR_EACH_PROCESSOR
bool PointFilter::TakeTogether(const Scan& scan, std::size_t i, PointColumns* points) const {
  const ScanPoint* const raw = scan.points.data() + i;
  float *const x = points->x + points->count, *const y = points->y + points->count,
               *const z = points->z + points->count, *const time_s = points->time_s + points->count,
               *const flat2 = points->flat2 + points->count,
               *const range2 = points->range2 + points->count;
  for (std::size_t k = 0; k < kTogether; ++k) {
    x[k] = raw[k].x, y[k] = raw[k].y, z[k] = raw[k].z;
  }
  const float min2 = min2_, max2 = max2_, earliest_s = earliest_s_, latest_s = latest_s_;
  int taken = 0;
  for (std::size_t k = 0; k < kTogether; ++k) {
    flat2[k] = x[k] * x[k] + y[k] * y[k];
    range2[k] = flat2[k] + z[k] * z[k];
    taken += range2[k] >= min2 && range2[k] <= max2 ? 1 : 0;
  }
  for (std::size_t k = 0; k < kTogether; ++k) {
    time_s[k] = timed_ ? scan.time_s[i + k] : 0.0F;
  }
  for (std::size_t k = 0; timed_ && k < kTogether; ++k) {
    taken -= time_s[k] >= earliest_s && time_s[k] <= latest_s ? 0 : 1;
  }
  return taken == static_cast<int>(kTogether);
}

void Append(const PointColumns& points, std::vector<TimedPoint>* to) {
  TimedPoint rows[PointColumns::kMost];
  for (std::size_t i = 0; i < points.count; ++i) {
    rows[i] = {points.x[i], points.y[i], points.z[i], points.time_s[i]};
  }
  to->insert(to->end(), rows, rows + points.count);
}

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
  VisitBeams(v, "beams", &beams);
  v.EnumChoice("beam_correction", &beam_correction, {"off", "auto"});
  v.EnumChoice("deskew", &deskew, {"off", "time", "azimuth", "auto"});
  v.EnumChoice("rotation", &rotation, {"clockwise", "counterclockwise"});
  v.Number("sweep_start_azimuth_deg", &sweep_start_azimuth_deg, -360.0, 360.0);
  v.Number("stamp_at_sweep_fraction", &stamp_at_sweep_fraction, 0.0, 1.0);
  v.Number("sweep_period_s", &sweep_period_s, 0.0, 10.0);
}

void ScanPreparationOptions::CheckTogether() const {
  if (min_range_m < max_range_m) return;
  std::ostringstream message;
  message << "preparation.min_range_m = " << min_range_m
          << ": must be less than preparation.max_range_m = " << max_range_m;
  throw OptionError(message.str());
}

PreparedScan PrepareScan(const Scan& scan, const ScanPreparationOptions& options,
                         double sweep_period_s, const SE3& T_vehicle_lidar) {
  using Deskew = ScanPreparationOptions::Deskew;
  const bool from_azimuth = options.deskew == Deskew::kAzimuth;
  const bool from_file =
      !scan.time_s.empty() && (options.deskew == Deskew::kTime || options.deskew == Deskew::kAuto);
  const double correction = Radians(options.vertical_correction_deg);
  const auto sine = static_cast<float>(std::sin(correction));
  const auto cosine = static_cast<float>(std::cos(correction));
  const auto range_offset = static_cast<float>(options.range_offset_m);
  const BeamTable beams(options.beams);
  const double period_s = options.sweep_period_s > 0.0 ? options.sweep_period_s : sweep_period_s;
  std::optional<TimeSpan> times;
  if (from_file) times = PossibleTimes(scan.time_s, period_s);
  const AzimuthClock clock(options, period_s);
  const PointFilter filter(options, times);

  PreparedScan result;
  result.points.reserve(scan.points.size());
  PointColumns points;
  for (std::size_t next = 0; next < scan.points.size();) {
    filter.Take(scan, &next, &points, &result);
    if (from_azimuth) clock.SetTimes(&points);
    if (!beams.empty()) CorrectBeams(beams, &points);
    if (sine != 0.0F) TurnUp(sine, cosine, &points);
    if (range_offset != 0.0F) LengthenRays(range_offset, &points);
    Append(points, &result.points);
  }
  MoveInto(T_vehicle_lidar, &result.points);
  return result;
}

std::optional<double> TimeBetween(const std::vector<StampNs>& stamps, std::size_t most) {
  std::vector<double> gaps_s;
  for (std::size_t i = stamps.size(); i-- > 1 && gaps_s.size() < most;) {
    if (stamps[i] > stamps[i - 1]) gaps_s.push_back(SecondsBetween(stamps[i - 1], stamps[i]));
  }
  if (gaps_s.empty()) return std::nullopt;
  return UpperMedian(&gaps_s);
}

double SweepPeriod(const std::vector<StampNs>& stamps_up_to_i, double fallback_s) {
  constexpr std::size_t kMost = 9;
  const double period_s = TimeBetween(stamps_up_to_i, kMost).value_or(fallback_s);
  return period_s <= kLongestSweepS ? period_s : fallback_s;
}

}  // namespace lamina
