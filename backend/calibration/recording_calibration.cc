#include "backend/calibration/recording_calibration.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "backend/calibration/calibration_drive.h"
#include "backend/mapping/scan_decoder.h"
#include "core/base/angle.h"
#include "core/base/error.h"

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

std::vector<CalibrationSegment> ReadClusterSegments(const ScanSource& source,
                                                    const MappingOptions& mapping,
                                                    std::size_t begin,
                                                    const CalibrationDrive& drive,
                                                    const CalibrationOptions& options) {
  return ReadSegments<CalibrationFrame>(
      SegmentsOf(drive, source, mapping, begin, options), [&](std::size_t i) {
        CalibrationFrame frame;
        frame.stamp_ns = drive.poses[i].stamp_ns;
        frame.T_world_lidar = drive.poses[i].T_world_lidar;
        frame.sweep = drive.MotionAt(i);
        frame.measured = DecodeScan(source, mapping.preparation, mapping.pipeline.min_points,
                                    mapping.mapper.map.LeafSize(), begin, drive.scans[i])
                             .clusters;
        return frame;
      });
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
    DriveSummary summary;
    const CalibrationDrive drive = MapDrive(source, begin, end, corrected, on_scan, stop, &summary);
    pass.frames = summary.frames;
    pass.lost = summary.lost;
    pass.map = summary.map;
    if (stop != nullptr && stop->load()) {
      all.result.status = CalibrationResult::Status::kInterrupted;
      break;
    }
    if (drive.poses.empty()) throw InputError("not one usable scan");
    std::vector<CalibrationSegment> segments =
        ReadClusterSegments(source, corrected, begin, drive, options);
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
