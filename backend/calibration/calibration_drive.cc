#include "backend/calibration/calibration_drive.h"

#include <utility>

#include "backend/mapping/pipeline.h"
#include "core/base/median.h"

namespace lamina {
namespace {

// Of the clusters of a few frames spread over the drive.
double MedianRange(const CalibrationDrive& drive, const ScanSource& source,
                   const MappingOptions& mapping, std::size_t begin) {
  constexpr std::size_t kLooks = 8;
  std::vector<double> ranges;
  for (std::size_t i = 0; i < kLooks; ++i) {
    const std::size_t scan = drive.scans[i * drive.scans.size() / kLooks];
    for (const TimedCluster& c :
         DecodeScan(source, mapping.preparation, mapping.pipeline.min_points,
                    mapping.mapper.map.LeafSize(), begin, scan)
             .clusters) {
      ranges.push_back(c.points.mean.norm());
    }
  }
  return ranges.empty() ? 0.0 : UpperMedian(&ranges);
}

CalibrationDrive LongestOf(const std::map<std::int64_t, CalibrationDrive>& pieces) {
  CalibrationDrive longest;
  for (const auto& [piece, drive] : pieces) {
    if (drive.poses.size() > longest.poses.size()) longest = drive;
  }
  return longest;
}

bool IsTracked(const MappedScan& scan) {
  return !scan.skipped && scan.odometry.status == OdometryFrame::Status::kTracked;
}

}  // namespace

SweepMotion CalibrationDrive::MotionAt(std::size_t i) const {
  SweepMotion motion;
  MotionThrough(poses, i, SlidingWindow::kMaxTwistGapS, &motion);
  return motion;
}

CalibrationDrive MapDrive(const ScanSource& source, std::size_t begin, std::size_t end,
                          const MappingOptions& mapping,
                          const std::function<void(const MappedScan&)>& on_scan,
                          const std::atomic<bool>* stop, DriveSummary* summary) {
  std::map<std::int64_t, CalibrationDrive> pieces;
  std::vector<bool> tracked(end - begin, false);
  MappingCallbacks callbacks;
  callbacks.on_scan = [&](const MappedScan& report) {
    tracked[report.index - begin] = IsTracked(report);
    if (on_scan) on_scan(report);
  };
  callbacks.on_final_pose = [&](const FinalPose& pose) {
    if (pose.skipped) return;
    CalibrationDrive& drive = pieces[pose.piece];
    drive.scans.push_back(pose.scan);
    drive.poses.push_back(pose.pose);
    drive.usable.push_back(tracked[pose.scan - begin]);
  };
  Mapping run(mapping, callbacks);
  MapScans(source, {begin, begin, end}, &run, stop);
  run.Finish();
  summary->frames = run.counts().frames;
  summary->lost = run.counts().lost;
  summary->map = MeasureThickness(run.map(), mapping.mapper.backend.min_surfel_frames);
  return LongestOf(pieces);
}

void DriveRecorder::Add(const MappedScan& scan) {
  if (scan.skipped) return;
  CalibrationDrive& drive = pieces_[scan.piece];
  drive.scans.push_back(scan.index);
  drive.poses.push_back({scan.stamp_ns, scan.odometry.T_world_lidar});
  drive.usable.push_back(IsTracked(scan));
}

CalibrationDrive DriveRecorder::Longest() const { return LongestOf(pieces_); }

std::vector<std::vector<std::size_t>> SegmentsOf(const CalibrationDrive& drive,
                                                 const ScanSource& source,
                                                 const MappingOptions& mapping, std::size_t begin,
                                                 const CalibrationOptions& options) {
  return PickSegments(drive.poses, drive.usable, MedianRange(drive, source, mapping, begin),
                      options);
}

}  // namespace lamina
