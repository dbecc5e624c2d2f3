#include "tools/run/opening_lines.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <utility>

#include "core/base/error.h"
#include "core/base/first_readable.h"
#include "core/base/printable_text.h"
#include "tools/results/posed_scans.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;
using Deskew = ScanPreparationOptions::Deskew;

struct FirstScan {
  Scan scan;
  PointTimeField times;
  std::string problem;  // why none of those that were tried can be read; empty if one can
};

FirstScan ReadFirst(const ScanSource& source, const FrameRange& range) {
  FirstScan first;
  const std::size_t end = std::min(range.end, range.begin + kReadTries);
  std::string error_of_first;
  for (std::size_t i = range.begin; i < end; ++i) {
    try {
      first.scan = source.Read(i);
      first.times = source.PointTimes(i);
      return first;
    } catch (const InputError& error) {
      // The run will say so, and goes on with the next one.
      if (i == range.begin) error_of_first = error.what();
    }
  }
  const std::size_t tried = end - std::min(range.begin, end);
  first.problem =
      tried == 1 ? error_of_first
                 : fmt::format("none of the first {} scans can be read; {}", tried, error_of_first);
  return first;
}

// Why mapping takes no point of a scan that can be read; empty if it takes some.
std::string DescribeRanges(const Scan& scan, const ScanPreparationOptions& preparation,
                           double period_s) {
  if (scan.points.empty() || !PrepareScan(scan, preparation, period_s).points.empty()) return "";
  constexpr double kFarM = 1e4;
  double nearest_m = std::numeric_limits<double>::infinity(), farthest_m = 0.0;
  for (const ScanPoint& p : scan.points) {
    const double range_m =
        std::hypot(static_cast<double>(p.x), static_cast<double>(p.y), static_cast<double>(p.z));
    if (!std::isfinite(range_m)) continue;
    nearest_m = std::min(nearest_m, range_m);
    farthest_m = std::max(farthest_m, range_m);
  }
  if (nearest_m > farthest_m) return "no point of the first scan is finite";
  return fmt::format(
      "the points of the first scan are {:.5g} to {:.5g} m from the origin, none within "
      "preparation.min_range_m={:.5g} to max_range_m={:.5g}{}",
      nearest_m, farthest_m, preparation.min_range_m, preparation.max_range_m,
      nearest_m > kFarM ? ": a map, and no scan in the frame of its sensor" : "");
}

std::string DescribeTimes(const FirstScan& first, Deskew deskew, const TimeSpan& span) {
  if (deskew == Deskew::kAzimuth) {
    return "times by their azimuth, used to deskew (preparation.deskew=azimuth)";
  }
  if (first.times.name.empty()) return "no times: each scan is taken as instantaneous";
  std::string text = fmt::format("times in field '{}'", Printable(first.times.name));
  if (!first.times.usable) return text + ", which tells no points apart: not deskewed";
  text += first.times.clock ? fmt::format(" in {}, readings of a clock, over {:.3f} s",
                                          first.times.unit, span.length_s())
                            : fmt::format(" in {}, {:.3f} to {:.3f} s from the stamp",
                                          first.times.unit, span.low_s, span.high_s);
  return text +
         (deskew == Deskew::kOff ? ", not used (preparation.deskew=off)" : ", used to deskew");
}

// What contradicts in the times of the first scan's points.
std::vector<std::string> DoubtsOfTimes(const FirstScan& first, Deskew deskew, const TimeSpan& span,
                                       double period_s) {
  std::vector<std::string> doubts;
  constexpr double kOverlap = 1.5;
  const bool by_times = deskew != Deskew::kOff && deskew != Deskew::kAzimuth;
  if (by_times && span.length_s() > kOverlap * period_s) {
    doubts.push_back(
        fmt::format("the times of a scan's points span {:.3f} s, but scans are {:.3f} s apart: is "
                    "their unit {} (scans.point_time_unit)?",
                    span.length_s(), period_s, first.times.unit));
  }
  // No reader decides for such times by itself.
  constexpr double kLeastSweepS = 1e-3, kLeastPeriodS = 0.01;
  if (by_times && span.length_s() > 0.0 && span.length_s() < kLeastSweepS &&
      period_s > kLeastPeriodS) {
    doubts.push_back(
        fmt::format("the times of a scan's points span only {:.3g} s: is their unit {} "
                    "(scans.point_time_unit)?",
                    span.length_s(), first.times.unit));
  }
  // A sweep is deskewed to its stamp: the farther off that is, the more the first scans, whose
  // motion is not known yet, lie off.
  constexpr double kOutsideS = 0.02;
  const double outside_s = std::max(span.low_s, -span.high_s);
  if (deskew != Deskew::kAzimuth && outside_s > kOutsideS) {
    doubts.push_back(fmt::format(
        "the stamp of the first scan is {:.3f} s {} all of its points: does it tell when the scan "
        "was measured, or when it was sent?",
        outside_s, span.low_s > 0.0 ? "before" : "after"));
  }
  if (deskew == Deskew::kTime && first.scan.time_s.empty() && !first.scan.points.empty()) {
    doubts.push_back("preparation.deskew=time, but the points have no times to use");
  }
  return doubts;
}

std::string DescribeConfig(const FittingConfig& fit, const std::string& given) {
  if (given.empty() && fit.measured) {
    return fmt::format("configuration {}: {} (--config default for the defaults)", fit.name,
                       fit.reason);
  }
  std::string text = given.empty() ? "default options" : "configuration " + Printable(given);
  if (fit.name.empty() || fit.name == fs::path(given).stem().string()) return text;
  return text + fmt::format("; --config {} may fit better: {}", fit.name, fit.reason);
}

}  // namespace

OpeningLines DescribeOpening(const ScanSource& source, const FrameRange& range,
                             const LaminaConfig& config, const FittingConfig& fit,
                             const std::string& given) {
  const RecordingDescription recording = source.Describe();
  const FirstScan first = ReadFirst(source, range);
  const SensorGuess sensor = GuessSensor(first.scan.points);
  const double period_s = SweepPeriodOfScan(source, range.begin, config.scans.frame_period_s);
  const double apart_s = TimeBetweenScans(source, range.begin, config.scans.frame_period_s);
  const TimeSpan span = SpanOfTimes(first.scan.time_s);
  const Deskew deskew = config.preparation.deskew;
  OpeningLines opening;
  opening.lines = {fmt::format("scans   {}; stamps {}, {:.4g} Hz", recording.scans,
                               recording.stamps, 1.0 / apart_s)};
  if (first.problem.empty()) {
    opening.lines.push_back(fmt::format("points  {} in the first scan; {}", sensor.points,
                                        DescribeTimes(first, deskew, span)));
  }
  if (sensor.farthest_m > 0.0) {
    opening.lines.push_back(
        fmt::format("sensor  {}, {:.0f} to {:.0f} deg up, {:.0f} deg around, up to {:.0f} m; {}",
                    sensor.rings > 0 ? fmt::format("{} rings", sensor.rings) : "no clear rings",
                    sensor.lowest_deg, sensor.highest_deg, sensor.around_deg, sensor.farthest_m,
                    DescribeConfig(fit, given)));
  }
  opening.doubts = recording.doubts;
  std::string unusable = first.problem;
  if (unusable.empty()) unusable = DescribeRanges(first.scan, config.preparation, period_s);
  opening.usable = unusable.empty();
  if (!opening.usable) opening.doubts.push_back(unusable);
  for (std::string& doubt : DoubtsOfTimes(first, deskew, span, apart_s)) {
    opening.doubts.push_back(std::move(doubt));
  }
  return opening;
}

std::string DescribeAgainstDeskewing(const DeskewChoice& choice) {
  const std::string what = choice.verdict == DeskewChoice::Verdict::kCompensated
                               ? "scans are compensated for motion already"
                               : "the points' times are understood wrongly, or are none";
  if (choice.by_beams) {
    return what +
           ": their points lie at the elevations of the sensor's beams once its motion is "
           "taken back, not as they are";
  }
  if (choice.deskewed_m == 0.0) {
    return what + ": scans are lost if deskewed by the points' times, and tracked as they are";
  }
  return fmt::format(
      "{}: planes are {:.1f} mm thick if deskewed by the points' times, {:.1f} mm as they are",
      what, 1e3 * choice.deskewed_m, 1e3 * choice.as_they_are_m);
}

std::string DescribeSweep(const SweepChoice& choice) {
  return fmt::format(
      "scans are sweeps that are not compensated for motion: planes are {:.1f} mm thick if "
      "deskewed by azimuth, {:.1f} mm as they are (preparation.deskew=azimuth, "
      "preparation.rotation={}, preparation.sweep_start_azimuth_deg={:.4g})",
      1e3 * choice.by_azimuth_m, 1e3 * choice.as_they_are_m,
      choice.rotation == ScanPreparationOptions::Rotation::kClockwise ? "clockwise"
                                                                      : "counterclockwise",
      choice.sweep_start_azimuth_deg);
}

}  // namespace lamina
