#include "backend/calibration/recording_calibration.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "backend/mapping/map_thickness.h"
#include "backend/mapping/pipeline.h"
#include "core/base/angle.h"
#include "core/base/error.h"
#include "core/base/median.h"
#include "core/base/parallel.h"
#include "core/geometry/sweep_motion.h"

namespace lamina {
namespace {

Intrinsics OffsetsOf(const ScanPreparationOptions& preparation) {
  return {preparation.vertical_correction_deg * kDegree, preparation.range_offset_m};
}

ScanPreparationOptions With(ScanPreparationOptions preparation, const Intrinsics& offsets) {
  preparation.vertical_correction_deg = offsets(0) / kDegree;
  preparation.range_offset_m = offsets(1);
  return preparation;
}

// Frames that are connected, of one piece of the map, with poses in its frame.
struct Drive {
  std::vector<std::size_t> scans;  // of each frame, in the source
  Trajectory poses;
  std::vector<bool> usable;  // tracked
};

// The longest piece.
Drive MapDrive(const ScanSource& source, std::size_t begin, std::size_t end,
               const MappingOptions& mapping, const std::function<void(const MappedScan&)>& on_scan,
               const std::atomic<bool>* stop, CalibrationPass* pass) {
  std::map<std::int64_t, Drive> pieces;
  std::vector<bool> tracked(end - begin, false);
  MappingCallbacks callbacks;
  callbacks.on_scan = [&](const MappedScan& report) {
    tracked[report.index - begin] =
        !report.skipped && report.odometry.status == OdometryFrame::Status::kTracked;
    if (on_scan) on_scan(report);
  };
  callbacks.on_final_pose = [&](const FinalPose& pose) {
    if (pose.skipped) return;
    Drive& drive = pieces[pose.piece];
    drive.scans.push_back(pose.scan);
    drive.poses.push_back(pose.pose);
    drive.usable.push_back(tracked[pose.scan - begin]);
  };
  Mapping run(mapping, callbacks);
  MapScans(source, {begin, begin, end}, &run, stop);
  run.Finish();
  pass->frames = run.counts().frames;
  pass->lost = run.counts().lost;
  pass->map = MeasureThickness(run.map(), mapping.mapper.backend.min_surfel_frames);
  Drive longest;
  for (auto& [piece, drive] : pieces) {
    if (drive.poses.size() > longest.poses.size()) longest = std::move(drive);
  }
  return longest;
}

std::vector<TimedCluster> ReadClusters(const ScanSource& source, const MappingOptions& mapping,
                                       std::size_t begin, std::size_t scan) {
  return DecodeScan(source, mapping.preparation, mapping.pipeline.min_points,
                    mapping.mapper.map.LeafSize(), begin, scan)
      .clusters;
}

// Of the clusters of a few frames spread over the drive.
double MedianRange(const ScanSource& source, const MappingOptions& mapping, std::size_t begin,
                   const Drive& drive) {
  constexpr std::size_t kLooks = 8;
  std::vector<double> ranges;
  for (std::size_t i = 0; i < kLooks; ++i) {
    const std::size_t scan = drive.scans[i * drive.scans.size() / kLooks];
    for (const TimedCluster& c : ReadClusters(source, mapping, begin, scan)) {
      ranges.push_back(c.points.mean.norm());
    }
  }
  return ranges.empty() ? 0.0 : UpperMedian(&ranges);
}

std::vector<CalibrationSegment> ReadSegments(const ScanSource& source,
                                             const MappingOptions& mapping, std::size_t begin,
                                             const Drive& drive,
                                             const CalibrationOptions& options) {
  std::vector<CalibrationSegment> segments;
  for (const std::vector<std::size_t>& frames : PickSegments(
           drive.poses, drive.usable, MedianRange(source, mapping, begin, drive), options)) {
    CalibrationSegment segment(frames.size());
    ParallelChunks(frames.size(), 1, [&](std::size_t a, std::size_t b) {
      for (std::size_t i = a; i < b; ++i) {
        CalibrationFrame& frame = segment[i];
        frame.stamp_ns = drive.poses[frames[i]].stamp_ns;
        frame.T_world_lidar = drive.poses[frames[i]].T_world_lidar;
        MotionThrough(drive.poses, frames[i], SlidingWindow::kMaxTwistGapS, &frame.sweep);
        frame.measured = ReadClusters(source, mapping, begin, drive.scans[frames[i]]);
      }
    });
    segments.push_back(std::move(segment));
  }
  return segments;
}

}  // namespace

RecordingCalibration CalibrateRecording(const ScanSource& source, std::size_t begin,
                                        std::size_t end, const MappingOptions& mapping,
                                        const CalibrationOptions& options,
                                        const std::function<void(const MappedScan&)>& on_scan,
                                        const std::function<void(const CalibrationPass&)>& on_pass,
                                        const std::atomic<bool>* stop) {
  const SensorCalibration calibration(options, mapping.mapper.map, mapping.mapper.backend.window);
  const Intrinsics configured = OffsetsOf(mapping.preparation);
  RecordingCalibration all;
  all.offsets = configured;
  for (int i = 0; i < options.max_passes && !all.settled; ++i) {
    MappingOptions corrected = mapping;
    corrected.preparation = With(mapping.preparation, all.offsets);
    CalibrationPass pass;
    pass.pass = i;
    pass.offsets = all.offsets;
    const Drive drive = MapDrive(source, begin, end, corrected, on_scan, stop, &pass);
    if (stop != nullptr && stop->load()) {
      all.result.status = CalibrationResult::Status::kInterrupted;
      break;
    }
    if (drive.poses.empty()) throw InputError("not one usable scan");
    std::vector<CalibrationSegment> segments =
        ReadSegments(source, corrected, begin, drive, options);
    if (segments.empty()) {
      throw InputError("the sensor hardly moves: frames from different places are needed");
    }
    pass.found = calibration.Run(&segments, nullptr, stop);
    // What an earlier pass has determined, and this one has not, stays as it was found.
    if (i > 0 && pass.found.determined != all.result.determined) break;
    all.result = pass.found;
    all.settled = true;
    for (int k = 0; k < 2; ++k) {
      if (!pass.found.determined[static_cast<std::size_t>(k)]) continue;
      all.settled = all.settled && std::abs(pass.found.offsets(k)) < pass.found.sigma(k);
      all.offsets(k) += pass.found.offsets(k);
    }
    all.passes.push_back(pass);
    if (on_pass) on_pass(pass);
    if (pass.found.status == CalibrationResult::Status::kInterrupted) break;
  }
  return all;
}

}  // namespace lamina
