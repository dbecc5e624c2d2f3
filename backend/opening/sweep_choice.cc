#include "backend/opening/sweep_choice.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "backend/mapping/scan_decoder.h"
#include "backend/opening/opening_look.h"
#include "core/base/error.h"
#include "core/base/first_readable.h"
#include "core/base/parallel.h"
#include "frontend/scan/horizontal_view.h"

namespace lamina {
namespace {

using Deskew = ScanPreparationOptions::Deskew;
using Rotation = ScanPreparationOptions::Rotation;

// Scans of a recording, thinned and held in memory. Those that cannot be read are left out.
class ThinnedScans final : public ScanSource {
 public:
  ThinnedScans(const ScanSource& source, std::size_t begin, std::size_t end)
      : recorded_stamps_(source.recorded_stamps()) {
    for (std::size_t i = begin; i < end; ++i) {
      try {
        scans_.push_back(Thinned(source.Read(i)));
      } catch (const InputError&) {
        continue;
      }
      T_vehicle_lidar_.push_back(source.T_vehicle_lidar(i));
    }
  }

  std::size_t size() const override { return scans_.size(); }
  std::string Name(std::size_t i) const override { return std::to_string(i); }
  StampNs Stamp(std::size_t i) const override { return scans_[i].stamp_ns; }
  SE3 T_vehicle_lidar(std::size_t i) const override { return T_vehicle_lidar_[i]; }
  Scan Read(std::size_t i) const override { return scans_[i]; }
  bool recorded_stamps() const override { return recorded_stamps_; }

 private:
  // The step is odd, so that files that hold one column of beams after the other keep all beams.
  static Scan Thinned(Scan scan) {
    constexpr std::size_t kEnoughPoints = 20000;
    const std::size_t step = scan.points.size() / kEnoughPoints | 1U;
    std::size_t kept = 0;
    for (std::size_t i = 0; i < scan.points.size(); i += step) scan.points[kept++] = scan.points[i];
    scan.points.resize(kept);
    return scan;
  }

  bool recorded_stamps_;
  std::vector<Scan> scans_;
  std::vector<SE3> T_vehicle_lidar_;
};

// How a sensor may have swept.
struct Sweep {
  Rotation rotation = Rotation::kClockwise;
  double start_deg = 0.0;
};

ScanPreparationOptions With(ScanPreparationOptions preparation, const Sweep& sweep) {
  preparation.deskew = Deskew::kAzimuth;
  preparation.rotation = sweep.rotation;
  preparation.sweep_start_azimuth_deg = sweep.start_deg;
  return preparation;
}

std::vector<Sweep> BothSenses(const std::vector<double>& starts_deg) {
  std::vector<Sweep> sweeps;
  for (const double start_deg : starts_deg) {
    sweeps.push_back({Rotation::kClockwise, start_deg});
    sweeps.push_back({Rotation::kCounterclockwise, start_deg});
  }
  return sweeps;
}

// How thick the planes of a map are, by most of them and by the thinnest, which clutter thickens
// least: the geometric mean of both.
double ThicknessOf(const OpeningLook& look) {
  return std::sqrt(look.map.thin_m * look.map.median_m);
}

// A look under a sweep; infinitely thick where its map tells nothing.
struct SweepLook {
  Sweep sweep;
  OpeningLook look;
  double thick_m = std::numeric_limits<double>::infinity();
};

// Looks at some scans under sweeps, all of which begin with the velocity that the look as they are
// has found: searching for it takes longer than all else where it is in doubt.
class SweepSearch {
 public:
  SweepSearch(const ScanSource& scans, const MappingOptions& options,
              const OpeningLook& as_they_are, const std::atomic<bool>* stop)
      : scans_(scans), options_(options), stop_(stop) {
    options_.mapper.start_velocity = as_they_are.start_velocity;
  }

  SweepLook Under(const Sweep& sweep) const {
    SweepLook found;
    found.sweep = sweep;
    found.look =
        LookAt(scans_, 0, scans_.size(), With(options_.preparation, sweep), options_, stop_);
    if (found.look.Tells()) found.thick_m = ThicknessOf(found.look);
    return found;
  }

  // The sense of rotation and the cut that make the thinnest map: by quarters of a turn, then by
  // halves of the step before. Of scans that were not swept, all of them make it clearly thicker,
  // to 1.15 to 2.3, and half the quarters tell. Where the cut is right the other sense has 1.22,
  // and opposite to it both senses 1.0 to 1.03: mostly two looks tell.
  SweepLook Thinnest(double as_they_are_m) const {
    constexpr double kHopeless = 1.15, kHopelessByTwo = 1.2;
    constexpr double kFirstStepDeg = 90.0, kLastStepDeg = 20.0;
    // Only the sector between a cut and another differs, and the quarters are common.
    constexpr double kClearly = 0.97;
    SweepLook best;
    const auto look_under = [&](const std::vector<Sweep>& sweeps, double clearly) {
      std::vector<SweepLook> looks(sweeps.size());
      ParallelChunks(sweeps.size(), 1, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) looks[i] = Under(sweeps[i]);
      });
      for (SweepLook& look : looks) {
        if (look.thick_m < clearly * best.thick_m) best = std::move(look);
      }
    };
    look_under(BothSenses({180.0}), 1.0);
    if (std::isfinite(best.thick_m) && best.thick_m > kHopelessByTwo * as_they_are_m) return best;
    look_under(BothSenses({0.0}), 1.0);
    if (best.thick_m > kHopeless * as_they_are_m) return best;
    look_under(BothSenses({90.0, -90.0}), 1.0);
    for (double step_deg = 0.5 * kFirstStepDeg; step_deg > kLastStepDeg; step_deg *= 0.5) {
      const auto turned = [&, from = best.sweep](double by_deg) {
        return Sweep{from.rotation, std::remainder(from.start_deg + by_deg, 360.0)};
      };
      look_under({turned(-step_deg), turned(step_deg)}, kClearly);
    }
    return best;
  }

 private:
  const ScanSource& scans_;
  MappingOptions options_;
  const std::atomic<bool>* stop_;
};

// What a stretch of scans tells.
struct Finding {
  enum class Verdict { kNothing, kAsTheyAre, kSwept };
  Verdict verdict = Verdict::kNothing;
  Sweep sweep;
  double by_azimuth_m = 0.0, as_they_are_m = 0.0;
};

// Looks at scans from `from` on; under `sweep`, or, without, under the one that fits best.
Finding LookForSweep(const ScanSource& source, std::size_t from, std::size_t end,
                     const MappingOptions& options, const std::optional<Sweep>& sweep,
                     const std::atomic<bool>* stop) {
  // Sweeps come to 0.45 to 0.85 of the thickness that they have as they are, on real drives at 3
  // m/s to 0.82; compensated scans to more than they have, and sensors that hardly move to 0.97
  // to 1.03.
  constexpr std::size_t kLeastScans = 10;
  Finding finding;
  const ThinnedScans scans(source, from, std::min(end, from + kLookScans));
  if (scans.size() < kLeastScans) return finding;
  ScanPreparationOptions off = options.preparation;
  off.deskew = Deskew::kOff;
  const OpeningLook as_they_are = LookAt(scans, 0, scans.size(), off, options, stop);
  if (!as_they_are.Tells()) return finding;
  const SweepSearch search(scans, options, as_they_are, stop);
  const double as_they_are_m = ThicknessOf(as_they_are);
  const SweepLook by_azimuth = sweep ? search.Under(*sweep) : search.Thinnest(as_they_are_m);
  if (stop != nullptr && stop->load()) return finding;
  if (!Comparable(by_azimuth.look, as_they_are)) return finding;
  finding.sweep = by_azimuth.sweep;
  finding.by_azimuth_m = by_azimuth.thick_m;
  finding.as_they_are_m = as_they_are_m;
  if (finding.by_azimuth_m < kClearlyThinner * finding.as_they_are_m) {
    finding.verdict = Finding::Verdict::kSwept;
  } else if (finding.by_azimuth_m > finding.as_they_are_m) {
    finding.verdict = Finding::Verdict::kAsTheyAre;
  }
  return finding;
}

// Whether one sensor took the scans, and its first points lie all around it.
bool IsOneSensorAllAround(const ScanSource& source, std::size_t begin, std::size_t end,
                          const MappingOptions& options) {
  constexpr double kAllAround = 0.75;
  for (std::size_t i = begin; i < end; ++i) {
    if (source.Sensor(i) != source.Sensor(begin)) return false;
  }
  for (std::size_t i = begin; i < std::min(end, begin + kReadTries); ++i) {
    const std::vector<TimedPoint> points =
        DecodeScan(source, options.preparation, options.pipeline.min_points,
                   options.mapper.map.LeafSize(), begin, i)
            .points;
    if (points.empty()) continue;
    HorizontalView view;
    for (const TimedPoint& p : points) view.Add(p.x, p.y);
    return view.share() >= kAllAround;
  }
  return false;
}

}  // namespace

SweepChoice ChooseSweep(const ScanSource& source, std::size_t begin, std::size_t end,
                        const MappingOptions& options, const std::atomic<bool>* stop) {
  using Verdict = Finding::Verdict;
  SweepChoice choice;
  if (options.preparation.deskew != Deskew::kAuto) return choice;
  if (PointTimesOf(source, begin, end) != PointTimes::kNone) return choice;
  if (!IsOneSensorAllAround(source, begin, end, options)) return choice;
  const std::size_t middle = begin + (end - begin) / 2;
  const Finding first = LookForSweep(source, begin, end, options, std::nullopt, stop);
  std::optional<Sweep> sweep;
  if (first.verdict == Verdict::kSwept) sweep = first.sweep;
  Finding second;
  if (first.verdict != Verdict::kAsTheyAre) {
    second = LookForSweep(source, middle, end, options, sweep, stop);
  }
  const Finding& telling = first.verdict != Verdict::kNothing ? first : second;
  choice.by_azimuth_m = telling.by_azimuth_m;
  choice.as_they_are_m = telling.as_they_are_m;
  if (telling.verdict != Verdict::kSwept || second.verdict == Verdict::kAsTheyAre) return choice;
  choice.swept = true;
  choice.rotation = telling.sweep.rotation;
  choice.sweep_start_azimuth_deg = telling.sweep.start_deg;
  return choice;
}

ScanPreparationOptions WithSweep(ScanPreparationOptions options, const SweepChoice& choice) {
  if (!choice.swept) return options;
  return With(std::move(options), {choice.rotation, choice.sweep_start_azimuth_deg});
}

SweepPeriodChoice ChooseSweepPeriod(const ScanSource& source, std::size_t begin, std::size_t end,
                                    const MappingOptions& options, const std::atomic<bool>* stop) {
  // Most sensors sweep ten times a second or more. Of the thinner planes, which beams that disagree
  // thicken least, half of the period makes thicker ones unless it is right; where the sensor
  // hardly moves, either will do.
  constexpr double kLongS = 0.15, kThinner = 0.95;
  SweepPeriodChoice choice;
  const ScanPreparationOptions& given = options.preparation;
  if (given.deskew != Deskew::kAzimuth || given.sweep_period_s > 0.0) return choice;
  const double period_s = source.recorded_stamps() ? PeriodByStamps(source, begin, end) : 0.0;
  if (period_s < kLongS) return choice;
  ScanPreparationOptions whole = given, halved = given;
  whole.sweep_period_s = period_s;
  halved.sweep_period_s = 0.5 * period_s;
  const auto looks = LookUnderBoth(source, begin, end, options, whole, halved, Comparable, stop);
  if (!looks) return choice;
  choice.by_stamps_m = looks->first.map.thin_m;
  choice.halved_m = looks->second.map.thin_m;
  if (choice.halved_m < kThinner * choice.by_stamps_m) choice.period_s = halved.sweep_period_s;
  return choice;
}

}  // namespace lamina
