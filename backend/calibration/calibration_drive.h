// The way of a recording whose sensor is to be calibrated: mapping finds the poses, and segments of
// frames are picked from the longest connected piece.
//
// Private to backend/calibration.
#pragma once

#include <Eigen/Core>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <vector>

#include "backend/calibration/sensor_calibration.h"
#include "backend/mapping/mapped_scan.h"
#include "backend/mapping/options.h"
#include "backend/opening/map_thickness.h"
#include "core/base/parallel.h"
#include "core/geometry/scan_source.h"
#include "core/geometry/se3.h"

namespace lamina {

// Frames that are connected, of one piece of the map, with poses in its frame.
struct CalibrationDrive {
  std::vector<std::size_t> scans;  // of each frame, in the source
  Trajectory poses;
  std::vector<bool> usable;  // tracked

  // Of frame i, through the poses before and after it.
  SweepMotion MotionAt(std::size_t i) const;
};

// The same of a mapping that goes on, as far as it has come: poses are those that odometry gave to
// each scan.
class DriveRecorder {
 public:
  void Clear() { pieces_.clear(); }
  void Add(const MappedScan& scan);
  // Of the longest piece.
  CalibrationDrive Longest() const;

 private:
  std::map<std::int64_t, CalibrationDrive> pieces_;
};

// What mapping said of all scans on the way.
struct DriveSummary {
  std::size_t frames = 0, lost = 0;
  MapThickness map;
};

// The longest piece of scans [begin, end). on_scan is called for each scan that is mapped, unless
// null.
CalibrationDrive MapDrive(const ScanSource& source, std::size_t begin, std::size_t end,
                          const MappingOptions& mapping,
                          const std::function<void(const MappedScan&)>& on_scan,
                          const std::atomic<bool>* stop, DriveSummary* summary);

// Numbers of the frames of each segment (PickSegments), by the median range of clusters of a few
// frames spread over the drive.
std::vector<std::vector<std::size_t>> SegmentsOf(const CalibrationDrive& drive,
                                                 const ScanSource& source,
                                                 const MappingOptions& mapping, std::size_t begin,
                                                 const CalibrationOptions& options);

// The frames of these segments, each read by its number in the drive, in parallel.
template <typename Frame, typename Read>
std::vector<std::vector<Frame>> ReadSegments(const std::vector<std::vector<std::size_t>>& segments,
                                             const Read& read) {
  std::vector<std::vector<Frame>> all;
  for (const std::vector<std::size_t>& numbers : segments) {
    std::vector<Frame>& segment = all.emplace_back(numbers.size());
    ParallelChunks(numbers.size(), 1, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) segment[i] = read(numbers[i]);
    });
  }
  return all;
}

// Moves the poses of a segment by a tangent step, six numbers a frame.
template <typename Frame>
void MovePoses(const Eigen::VectorXd& step, std::vector<Frame>* segment) {
  for (std::size_t k = 0; k < segment->size(); ++k) {
    SE3& T = (*segment)[k].T_world_lidar;
    T = Retract(T, step.segment<6>(static_cast<Eigen::Index>(6 * k)));
  }
}

}  // namespace lamina
