#include "backend/calibration/recording_beams.h"

#include <cmath>
#include <utility>

#include "backend/calibration/beam_calibration.h"
#include "backend/calibration/calibration_drive.h"
#include "backend/mapping/scan_decoder.h"
#include "core/base/median.h"

namespace lamina {
namespace {

// Points of a frame that take part, at most.
constexpr std::size_t kMostPoints = 6000;

ScanPreparationOptions Uncorrected(ScanPreparationOptions preparation) {
  preparation.vertical_correction_deg = 0.0;
  preparation.range_offset_m = 0.0;
  preparation.beams.clear();
  return preparation;
}

std::vector<TimedPoint> ReadPoints(const ScanSource& source, const MappingOptions& mapping,
                                   std::size_t begin, std::size_t scan) {
  return DecodeScan(source, Uncorrected(mapping.preparation), mapping.pipeline.min_points,
                    mapping.mapper.map.LeafSize(), begin, scan)
      .points;
}

// From some of the scans.
std::vector<double> FindBeamsOf(const ScanSource& source, const MappingOptions& mapping,
                                std::size_t begin, std::size_t end) {
  constexpr std::size_t kLooks = 8;
  // Of the median range. Nearer points tell little of where a beam points: files count in
  // millimetres, and beams do not meet in one place to the last of them.
  constexpr float kNear = 0.25F;
  std::vector<float> ranges, sines;
  for (std::size_t i = 0; i < kLooks; ++i) {
    for (const TimedPoint& p :
         ReadPoints(source, mapping, begin, begin + i * (end - begin) / kLooks)) {
      ranges.push_back(std::sqrt(p.x * p.x + p.y * p.y + p.z * p.z));
      sines.push_back(p.z / ranges.back());
    }
  }
  if (ranges.empty()) return {};
  std::vector<float> sorted = ranges;
  const float nearest_m = kNear * UpperMedian(&sorted);
  std::vector<float> far;
  for (std::size_t i = 0; i < ranges.size(); ++i) {
    if (ranges[i] >= nearest_m) far.push_back(sines[i]);
  }
  return FindBeams(far);
}

// At most kMostPoints, chosen by a hash of their number: files have them in columns of beams, and
// each n-th point would be of few beams.
std::vector<TimedPoint> ThinnedByHash(const std::vector<TimedPoint>& points) {
  constexpr std::uint64_t kFactor = 0x9E3779B97F4A7C15;
  const std::uint64_t step = points.size() / kMostPoints + 1;
  std::vector<TimedPoint> kept;
  for (std::uint64_t i = 0; i < points.size(); ++i) {
    if (((i * kFactor) >> 40) % step == 0) kept.push_back(points[i]);
  }
  return kept;
}

std::vector<BeamCalibrationSegment> ReadBeamSegments(const ScanSource& source,
                                                     const MappingOptions& mapping,
                                                     std::size_t begin,
                                                     const CalibrationDrive& drive,
                                                     const CalibrationOptions& options) {
  if (drive.poses.empty()) return {};
  return ReadSegments<BeamCalibrationFrame>(
      SegmentsOf(drive, source, mapping, begin, options), [&](std::size_t i) {
        BeamCalibrationFrame frame;
        frame.T_world_lidar = drive.poses[i].T_world_lidar;
        frame.sweep = drive.MotionAt(i);
        frame.points = ThinnedByHash(ReadPoints(source, mapping, begin, drive.scans[i]));
        return frame;
      });
}

}  // namespace

RecordingBeams CalibrateRecordingBeams(const ScanSource& source, std::size_t begin, std::size_t end,
                                       const MappingOptions& mapping,
                                       const CalibrationOptions& options,
                                       const std::function<void(const MappedScan&)>& on_scan,
                                       const std::atomic<bool>* stop) {
  DriveSummary summary;
  const CalibrationDrive drive = MapDrive(source, begin, end, mapping, on_scan, stop, &summary);
  return CalibrateDriveBeams(source, begin, end, drive, mapping, options, stop);
}

RecordingBeams CalibrateDriveBeams(const ScanSource& source, std::size_t begin, std::size_t end,
                                   const CalibrationDrive& drive, const MappingOptions& mapping,
                                   const CalibrationOptions& options,
                                   const std::atomic<bool>* stop) {
  RecordingBeams found;
  const std::vector<double> elevations = FindBeamsOf(source, mapping, begin, end);
  found.on_cones = !elevations.empty();
  if (!found.on_cones) {
    found.why = "its points do not lie on cones, one a beam";
    return found;
  }
  std::vector<BeamCalibrationSegment> segments =
      ReadBeamSegments(source, mapping, begin, drive, options);
  if (segments.empty()) {
    found.why = "too few scans from different places are connected";
    return found;
  }
  VoxelMapOptions map = mapping.mapper.map;
  map.noise_floor_m = options.noise_floor_m;
  BeamCalibrationResult result = CalibrateBeams(elevations, map, &segments, stop);
  found.thickness_before_m = result.thickness_before_m;
  found.thickness_m = result.thickness_m;
  if (result.Thinner()) {
    found.beams = std::move(result.beams);
  } else {
    found.why = "planes are as thick whatever each beam has wrong";
  }
  return found;
}

}  // namespace lamina
