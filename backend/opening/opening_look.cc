#include "backend/opening/opening_look.h"

#include <algorithm>
#include <vector>

#include "backend/mapping/pipeline.h"
#include "core/base/first_readable.h"
#include "core/base/parallel.h"

namespace lamina {
namespace {

// A sensor that is at rest shakes by less.
constexpr double kLeastWayM = 1.0, kLeastTurnRad = 0.2;
constexpr std::size_t kLeastPlanes = 50;

Vector6d StartVelocity(const Trajectory& poses) {
  const double gap_s = SecondsBetween(poses[0].stamp_ns, poses[1].stamp_ns);
  if (gap_s <= 0.0) return Vector6d::Zero();
  return MeanTwist(poses[0].T_world_lidar, poses[1].T_world_lidar, gap_s);
}

}  // namespace

bool OpeningLook::HasPlanes() const { return map.planes >= kLeastPlanes; }

bool OpeningLook::Tells() const {
  return IsSure() && (way_m > kLeastWayM || turn_rad > kLeastTurnRad);
}

bool OpeningLook::IsSure() const { return tracked && determined && HasPlanes(); }

OpeningLook LookAt(const ScanSource& source, std::size_t begin, std::size_t end,
                   const ScanPreparationOptions& preparation, MappingOptions options,
                   const std::atomic<bool>* stop) {
  options.preparation = preparation;
  options.loops.enabled = false;
  OpeningLook look;
  Trajectory& poses = look.poses;
  MappingCallbacks callbacks;
  callbacks.on_final_pose = [&](const FinalPose& pose) {
    if (!pose.skipped) poses.push_back(pose.pose);
  };
  Mapping run(options, callbacks);
  MapScans(source, {begin, begin, end}, &run, stop);
  run.Finish();
  look.tracked = run.counts().lost == 0 && poses.size() * 2 > end - begin;
  look.determined = run.counts().MostlyDetermined();
  look.lost_share = static_cast<double>(run.counts().lost) / static_cast<double>(end - begin);
  for (std::size_t i = 1; i < poses.size(); ++i) {
    const SE3 step = poses[i - 1].T_world_lidar.Inverse() * poses[i].T_world_lidar;
    look.way_m += step.t.norm();
    look.turn_rad += LogSO3(step.q).norm();
  }
  if (poses.size() > 1) look.start_velocity = StartVelocity(poses);
  look.map = MeasureThickness(run.map(), options.mapper.backend.min_surfel_frames);
  return look;
}

bool Misled(const OpeningLook& deskewed, const OpeningLook& as_they_are) {
  constexpr double kMostlyLost = 0.5, kNearlyAllLost = 0.75;
  if (deskewed.tracked || !as_they_are.Tells()) return false;
  if (!deskewed.HasPlanes() || deskewed.lost_share > kNearlyAllLost) return true;
  const double thinner = deskewed.lost_share > kMostlyLost ? kClearlyThinner : 1.0;
  return deskewed.map.median_m > thinner * as_they_are.map.median_m;
}

bool Comparable(const OpeningLook& a, const OpeningLook& b) {
  constexpr double kAlike = 0.8;
  const auto alike = [&](double x, double y) { return std::min(x, y) >= kAlike * std::max(x, y); };
  const bool moved = (std::min(a.way_m, b.way_m) > kLeastWayM && alike(a.way_m, b.way_m)) ||
                     std::min(a.turn_rad, b.turn_rad) > kLeastTurnRad;
  return a.IsSure() && b.IsSure() && moved;
}

std::optional<std::pair<OpeningLook, OpeningLook>> LookUnderBoth(
    const ScanSource& source, std::size_t begin, std::size_t end, const MappingOptions& options,
    const ScanPreparationOptions& one, const ScanPreparationOptions& other,
    const TellsOfBoth& tells, const std::atomic<bool>* stop) {
  for (const std::size_t from : {begin, begin + (end - begin) / 2}) {
    const std::size_t to = std::min(end, from + kLookScans);
    const ScanPreparationOptions* const ways[] = {&one, &other};
    OpeningLook looks[2];
    ParallelChunks(2, 1, [&](std::size_t first, std::size_t last) {
      for (std::size_t i = first; i < last; ++i)
        looks[i] = LookAt(source, from, to, *ways[i], options, stop);
    });
    if (stop != nullptr && stop->load()) break;
    if (tells(looks[0], looks[1])) return std::make_pair(looks[0], looks[1]);
  }
  return std::nullopt;
}

double PeriodByStamps(const ScanSource& source, std::size_t begin, std::size_t end) {
  constexpr std::size_t kMost = 5;
  std::vector<StampNs> stamps;
  for (std::size_t i = begin; i < end && stamps.size() < kMost; ++i) {
    if (source.Sensor(i) == source.Sensor(begin)) stamps.push_back(source.Stamp(i));
  }
  return SweepPeriod(stamps, 0.0);
}

PointTimes PointTimesOf(const ScanSource& source, std::size_t begin, std::size_t end) {
  constexpr double kMostPeriods = 1.5;
  const double period_s = PeriodByStamps(source, begin, end);
  const auto times_of = [&](std::size_t i) {
    const std::vector<float> times = source.Read(i).time_s;
    if (times.empty()) return PointTimes::kNone;
    return UsualSpanOfTimes(times).length_s() < kMostPeriods * period_s ? PointTimes::kOfTheScan
                                                                        : PointTimes::kLonger;
  };
  return FirstReadable(begin, end, times_of).value_or(PointTimes::kUnknown);
}

}  // namespace lamina
