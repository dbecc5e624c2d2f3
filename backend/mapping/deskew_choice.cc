#include "backend/mapping/deskew_choice.h"

#include <algorithm>
#include <optional>
#include <utility>
#include <vector>

#include "backend/mapping/map_thickness.h"
#include "backend/mapping/pipeline.h"
#include "core/base/error.h"

namespace lamina {
namespace {

using Deskew = ScanPreparationOptions::Deskew;

constexpr std::size_t kScans = 20;

struct Look {
  bool tracked = false;  // throughout
  double way_m = 0.0, turn_rad = 0.0;
  MapThickness map;
};

Look MapAndLook(const ScanSource& source, std::size_t begin, std::size_t end,
                const ScanPreparationOptions& preparation, MappingOptions options,
                const std::atomic<bool>* stop) {
  options.preparation = preparation;
  options.loops.enabled = false;
  Look look;
  Trajectory poses;
  MappingCallbacks callbacks;
  callbacks.on_final_pose = [&](const FinalPose& pose) {
    if (!pose.skipped) poses.push_back(pose.pose);
  };
  Mapping run(options, callbacks);
  MapScans(source, {begin, begin, end}, &run, stop);
  run.Finish();
  look.tracked = run.counts().lost == 0 && poses.size() * 2 > end - begin;
  for (std::size_t i = 1; i < poses.size(); ++i) {
    const SE3 step = poses[i - 1].T_world_lidar.Inverse() * poses[i].T_world_lidar;
    look.way_m += step.t.norm();
    look.turn_rad += LogSO3(step.q).norm();
  }
  look.map = MeasureThickness(run.map(), options.mapper.backend.min_surfel_frames);
  return look;
}

// A sensor that is at rest shakes by less.
constexpr double kLeastWayM = 1.0, kLeastTurnRad = 0.2;
constexpr std::size_t kLeastPlanes = 50;

// Whether the maps of both say anything: the sensor moved, and both found much the same.
bool Comparable(const Look& a, const Look& b) {
  constexpr double kAlike = 0.8;
  const auto alike = [&](double x, double y) { return std::min(x, y) >= kAlike * std::max(x, y); };
  const bool moved = (std::min(a.way_m, b.way_m) > kLeastWayM && alike(a.way_m, b.way_m)) ||
                     std::min(a.turn_rad, b.turn_rad) > kLeastTurnRad;
  return a.tracked && b.tracked && moved && std::min(a.map.planes, b.map.planes) >= kLeastPlanes;
}

// Whether scans are lost by their times alone.
bool Misled(const Look& deskewed, const Look& as_they_are) {
  const bool moved = as_they_are.way_m > kLeastWayM || as_they_are.turn_rad > kLeastTurnRad;
  return !deskewed.tracked && as_they_are.tracked && moved &&
         as_they_are.map.planes >= kLeastPlanes;
}

// The maps under both: of the first scans, or, where `tells` says that these tell nothing, of some
// from the middle. Nothing if neither tells, or if it was stopped.
template <typename Tells>
std::optional<std::pair<Look, Look>> LookUnderBoth(const ScanSource& source, std::size_t begin,
                                                   std::size_t end, const MappingOptions& options,
                                                   const ScanPreparationOptions& one,
                                                   const ScanPreparationOptions& other,
                                                   const Tells& tells,
                                                   const std::atomic<bool>* stop) {
  for (const std::size_t from : {begin, begin + (end - begin) / 2}) {
    const std::size_t to = std::min(end, from + kScans);
    const Look first = MapAndLook(source, from, to, one, options, stop);
    const Look second = MapAndLook(source, from, to, other, options, stop);
    if (stop != nullptr && stop->load()) break;
    if (tells(first, second)) return std::make_pair(first, second);
  }
  return std::nullopt;
}

enum class Times { kNone, kOfTheScan, kLonger };

// Between the first scans of a sensor; 0 where they tell none.
double PeriodByStamps(const ScanSource& source, std::size_t begin, std::size_t end) {
  constexpr std::size_t kMost = 5;
  std::vector<StampNs> stamps;
  for (std::size_t i = begin; i < end && stamps.size() < kMost; ++i) {
    if (source.Sensor(i) == source.Sensor(begin)) stamps.push_back(source.Stamp(i));
  }
  return SweepPeriod(stamps, 0.0);
}

// How the times of the points lie between the stamps.
Times TimesOf(const ScanSource& source, std::size_t begin, std::size_t end) {
  constexpr std::size_t kTries = 5;
  constexpr double kMostPeriods = 1.5;
  const double period_s = PeriodByStamps(source, begin, end);
  for (std::size_t i = begin; i < std::min(end, begin + kTries); ++i) {
    try {
      const std::vector<float> times = source.Read(i).time_s;
      if (times.empty()) return Times::kNone;
      const auto [first, last] = std::minmax_element(times.begin(), times.end());
      const double length_s = static_cast<double>(*last) - static_cast<double>(*first);
      return length_s < kMostPeriods * period_s ? Times::kOfTheScan : Times::kLonger;
    } catch (const InputError&) {
      // The next one may be readable.
    }
  }
  return Times::kNone;
}

}  // namespace

DeskewChoice ChooseDeskew(const ScanSource& source, std::size_t begin, std::size_t end,
                          const MappingOptions& options, const std::atomic<bool>* stop) {
  // Differences of fewer per cent are within what maps of so few scans vary by.
  constexpr double kClearlyThinner = 0.9;
  DeskewChoice choice;
  if (options.preparation.deskew != Deskew::kAuto) return choice;
  const Times times = TimesOf(source, begin, end);
  if (times == Times::kNone) return choice;
  ScanPreparationOptions by_times = options.preparation, off = options.preparation;
  by_times.deskew = Deskew::kTime;
  off.deskew = Deskew::kOff;
  const auto looks = LookUnderBoth(
      source, begin, end, options, by_times, off,
      [](const Look& a, const Look& b) { return Misled(a, b) || Comparable(a, b); }, stop);
  if (!looks) return choice;
  const auto& [deskewed, as_they_are] = *looks;
  if (Misled(deskewed, as_they_are)) {
    choice.verdict = DeskewChoice::Verdict::kWrongTimes;
    return choice;
  }
  choice.deskewed_m = deskewed.map.median_m;
  choice.as_they_are_m = as_they_are.map.median_m;
  if (choice.as_they_are_m < kClearlyThinner * choice.deskewed_m) {
    choice.verdict = times == Times::kOfTheScan ? DeskewChoice::Verdict::kCompensated
                                                : DeskewChoice::Verdict::kWrongTimes;
  }
  return choice;
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
