#include "backend/calibration/opening_calibration.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>

#include "backend/calibration/calibration_drive.h"
#include "backend/calibration/recording_beams.h"
#include "backend/calibration/recording_calibration.h"
#include "backend/mapping/pipeline.h"
#include "core/base/angle.h"
#include "core/base/error.h"
#include "core/options/options.h"
#include "frontend/scan/horizontal_view.h"

namespace lamina {
namespace {

using Outcome = OpeningCalibration::Outcome;
using BeamCorrection = ScanPreparationOptions::BeamCorrection;

// The map is looked at after so many scans, or a multiple of them, once there are enough keyframes:
// a sensor that stands still tells nothing.
constexpr std::size_t kOpeningScans = 50, kLeastKeyframes = 40, kMostOpeningScans = 400;
// Fewer tell nothing of thickness.
constexpr std::size_t kLeastPlanes = 200;

// Generated drives, a quarter of the planes thinner than: 2 mm with an exact sensor, 7 mm with 2 cm
// of noise, 6 to 8 mm with beams that are off by 0.1 degrees each, 9 / 13 / 18 mm with beams off by
// 0.125 / 0.25 / 0.5 degrees; 13 mm on real recordings. The noise floor of matching is 20 mm.
bool IsLookedAt(const MapThickness& map, const MappingOptions& options) {
  constexpr double kAllowedShare = 0.25;
  return map.planes >= kLeastPlanes &&
         map.thin_m > kAllowedShare * options.mapper.map.noise_floor_m;
}

bool Stopped(const std::atomic<bool>* stop) { return stop != nullptr && stop->load(); }

// Whether all scans are of one sensor, in whose frame they are mapped.
bool IsOneSensor(const ScanSource& source, std::size_t begin, std::size_t end) {
  for (std::size_t i = begin; i < end; ++i) {
    if (source.Sensor(i) != source.Sensor(begin)) return false;
    const SE3 T = source.T_vehicle_lidar(i);
    if (!T.t.isZero(0.0) || T.q.vec().norm() > 0.0) return false;
  }
  return true;
}

// Whether the points of a scan lie all around the sensor, or around half of it at least.
bool SeesAround(const ScanSource& source, std::size_t begin, std::size_t end,
                const MappingOptions& mapping) {
  std::vector<TimedPoint> points;
  for (std::size_t i = begin; i < end && points.empty(); ++i) {
    points = DecodeScan(source, mapping.preparation, mapping.pipeline.min_points,
                        mapping.mapper.map.LeafSize(), begin, i)
                 .points;
  }
  HorizontalView view;
  for (const TimedPoint& p : points) view.Add(p.x, p.y);
  return view.share() >= 0.5;
}

// The largest angle between the z axis of a tracked scan and that of the first.
class Lean {
 public:
  void Add(const MappedScan& scan) {
    if (scan.skipped || scan.odometry.status == OdometryFrame::Status::kLost) return;
    const Eigen::Vector3d up = scan.odometry.T_world_lidar.R().col(2);
    if (!first_) first_ = up;
    largest_rad_ = std::max(largest_rad_, std::atan2(first_->cross(up).norm(), first_->dot(up)));
  }
  double largest_deg() const { return Degrees(largest_rad_); }

 private:
  std::optional<Eigen::Vector3d> first_;
  double largest_rad_ = 0.0;
};

// How many of the tracked scans were deskewed by a motion of their own (shaken_sweep.h).
class ShakenShare {
 public:
  void Clear() { tracked_ = shaken_ = 0; }
  void Add(const MappedScan& scan) {
    if (scan.skipped || scan.odometry.status != OdometryFrame::Status::kTracked) return;
    ++tracked_;
    if (scan.odometry.sweep.of_scan) ++shaken_;
  }
  // One jolt is none.
  bool IsShaken() const { return 10 * shaken_ > tracked_; }

 private:
  std::size_t tracked_ = 0, shaken_ = 0;
};

// The elevation offset of all beams by the first scans, refused if it is not beyond doubt.
void CalibrateElevation(const ScanSource& source, std::size_t begin, std::size_t end,
                        const MappingOptions& mapping, CalibrationOptions calibration,
                        const std::atomic<bool>* stop, OpeningCalibration* opening) {
  constexpr double kClearSigmas = 3.0, kMostLeanDeg = 10.0;
  calibration.max_passes = 1;
  // Of so few scans a range offset takes up what they have in common by chance: elevation alone.
  calibration.max_range_sigma_m = 1e-6;
  if (!SeesAround(source, begin, end, mapping)) {
    opening->why = "the sensor sees to one side";
    return;
  }
  Lean lean;
  RecordingCalibration found;
  try {
    found = CalibrateRecording(
        source, begin, end, mapping, calibration, [&](const MappedScan& scan) { lean.Add(scan); },
        nullptr, stop);
  } catch (const InputError& error) {
    opening->why = error.what();  // too few frames that are connected
    return;
  }
  if (Stopped(stop) || found.passes.empty()) return;
  const bool determined = found.result.determined[0];
  opening->elevation_rad = determined ? found.offsets(0) : 0.0;
  opening->sigma_rad = found.result.sigma(0);
  if (lean.largest_deg() > kMostLeanDeg) {
    opening->why = "the sensor leans over as it moves";
  } else if (!determined) {
    opening->why = "these scans do not determine by what";
  } else if (std::abs(opening->elevation_rad) <= kClearSigmas * opening->sigma_rad) {
    opening->why = "by what is within its standard deviation";
  } else {
    opening->outcome = Outcome::kCorrected;
  }
}

// Calibrates the first scans, mapped as `drive`, of a recording that ends at `all_end`. Refused if
// nothing is found beyond doubt; whether their map becomes thinner by what is found is not known
// yet.
OpeningCalibration CalibrateOpening(const ScanSource& source, std::size_t begin, std::size_t end,
                                    std::size_t all_end, const CalibrationDrive& drive, bool shaken,
                                    MappingOptions mapping, const CalibrationOptions& calibration,
                                    const std::atomic<bool>* stop) {
  mapping.loops.enabled = false;
  OpeningCalibration opening;
  opening.outcome = Outcome::kRefused;
  opening.scans = end - begin;
  if (!IsOneSensor(source, begin, all_end)) {
    opening.why = "scans are of several sensors, or of one that is mounted on a vehicle";
    return opening;
  }
  if (shaken) {
    opening.why = "the sensor is shaken";
    return opening;
  }
  const RecordingBeams each =
      CalibrateDriveBeams(source, begin, end, drive, mapping, calibration, stop);
  if (Stopped(stop)) return OpeningCalibration();
  if (each.on_cones) {
    opening.why = each.why;
    opening.beams = each.beams;
    if (!each.beams.empty()) opening.outcome = Outcome::kCorrected;
    return opening;
  }
  CalibrateElevation(source, begin, end, mapping, calibration, stop, &opening);
  return Stopped(stop) ? OpeningCalibration() : opening;
}

bool LooksFor(const ScanPreparationOptions& preparation) {
  return preparation.beam_correction == BeamCorrection::kAuto &&
         preparation.vertical_correction_deg == 0.0 && preparation.range_offset_m == 0.0 &&
         preparation.beams.empty();
}

MapThickness ThicknessOf(Mapping* mapping) {
  mapping->TakeInDueSolves();
  return MeasureThickness(mapping->map(), mapping->options().mapper.backend.min_surfel_frames);
}

// Of the maps of the same scans, the geometric mean of both figures: beams that are off each by
// themselves thicken a quarter of the planes, whatever is corrected for all.
bool Thinner(const MapThickness& after, const MapThickness& before, double share) {
  return after.planes >= kLeastPlanes &&
         after.thin_m * after.median_m < share * share * before.thin_m * before.median_m;
}

// The mapping of a recording, begun as often as it takes.
class CorrectingRun {
 public:
  CorrectingRun(const ScanSource& source, std::size_t begin, std::size_t end,
                const MappingOptions& options, const BeginMapping& begin_mapping,
                const std::atomic<bool>* stop)
      : source_(source),
        begin_(begin),
        end_(end),
        options_(options),
        begin_mapping_(begin_mapping),
        stop_(stop) {
    Begin(options_);
  }

  // Maps the first scans, and corrects beams by what they tell.
  void MapOpening(const CalibrationOptions& calibration) {
    const std::size_t most = std::min(end_, begin_ + kMostOpeningScans);
    while (Next() < most && run_.mapping->counts().keyframes < kLeastKeyframes && !Stopped(stop_)) {
      MapUntil(std::min(most, Next() + kOpeningScans));
    }
    // Few keyframes of many scans: it stands still, or is lost.
    if (Stopped(stop_) || run_.mapping->counts().keyframes < kLeastKeyframes) return;
    const MapThickness before = ThicknessOf(run_.mapping);
    if (!IsLookedAt(before, options_)) return;
    run_.opening = CalibrateOpening(source_, begin_, Next(), end_, drive_.Longest(),
                                    shaken_.IsShaken(), options_, calibration, stop_);
    run_.opening.before = before;
    // What is known only in part are the poses, too, that beams were found by.
    if (run_.opening.outcome != Outcome::kCorrected) return;
    if (run_.mapping->counts().MostlyDetermined()) {
      Try();
    } else {
      Refuse("most scans leave a direction open");
    }
  }
  MappedRecording MapRest() {
    drive_.Clear();
    run_.processed += MapScans(source_, {begin_, Next(), end_}, run_.mapping, stop_);
    return run_;
  }

 private:
  std::size_t Next() const { return begin_ + run_.processed; }
  void Begin(const MappingOptions& options) {
    run_.mapping = begin_mapping_(options);
    run_.processed = 0;
    drive_.Clear();
    shaken_.Clear();
  }
  void Refuse(const std::string& why) {
    run_.opening.outcome = Outcome::kRefused;
    run_.opening.why = why;
  }
  // Of the opening.
  void MapUntil(std::size_t end) {
    run_.processed +=
        MapScans(source_, {begin_, Next(), end}, run_.mapping, stop_, [&](const MappedScan& scan) {
          drive_.Add(scan);
          shaken_.Add(scan);
        });
  }
  // The thickness that is believed of what was found, as a share of what it was: of an angle, and
  // of each beam by itself, which explains more by chance.
  static constexpr double kThinner = 0.99, kThinnerByEach = 0.9;

  // Begins anew with what was found, and once more if the map is not thinner by it.
  void Try() {
    const std::size_t lost = run_.mapping->counts().lost;
    MappingOptions corrected = options_;
    corrected.preparation.vertical_correction_deg = Degrees(run_.opening.elevation_rad);
    corrected.preparation.beams = run_.opening.beams;
    try {
      CheckOptions(corrected.preparation, "preparation");
    } catch (const OptionError& error) {
      Refuse(error.what());
      return;
    }
    Begin(corrected);
    MapUntil(begin_ + run_.opening.scans);
    if (Stopped(stop_)) return;
    run_.opening.after = ThicknessOf(run_.mapping);
    const double share = run_.opening.beams.empty() ? kThinner : kThinnerByEach;
    if (run_.mapping->counts().lost <= lost &&
        Thinner(run_.opening.after, run_.opening.before, share))
      return;
    Refuse("planes are as thick with what was found");
    Begin(options_);
  }

  const ScanSource& source_;
  const std::size_t begin_, end_;
  const MappingOptions& options_;
  const BeginMapping& begin_mapping_;
  const std::atomic<bool>* const stop_;
  MappedRecording run_;
  DriveRecorder drive_;
  ShakenShare shaken_;
};

}  // namespace

MappedRecording MapWithBeamCorrection(const ScanSource& source, std::size_t begin, std::size_t end,
                                      const MappingOptions& options,
                                      const CalibrationOptions& calibration,
                                      const BeginMapping& begin_mapping,
                                      const std::atomic<bool>* stop) {
  CorrectingRun run(source, begin, end, options, begin_mapping, stop);
  if (LooksFor(options.preparation)) run.MapOpening(calibration);
  return run.MapRest();
}

}  // namespace lamina
