// The threads around the mapper: scans in, poses and map out.
//
//     read + prepare + cluster    parallel over the next scans
//       -> odometry, window, map  serial, in the order of the scans (SerialMapping)
//            -> bundle adjustment one window in flight, beside the next scans' odometry
//       -> callbacks              for each scan, in order, as soon as its pose is known
//
// Bounded: at most `lookahead_scans` are between the first stage and the last, so back-pressure
// reaches the reader. A window's correction takes effect a fixed number of frames after it was
// started, never "when it is ready". Therefore the result is the same, bit for bit, at any number
// of threads; and whether the scans are there at once or come one by one.
//
// Memory does not grow with the number of scans: poses are handed on when they are final.
#pragma once

#include <atomic>
#include <cstddef>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "backend/mapping/final_poses.h"
#include "backend/mapping/options.h"
#include "backend/mapping/report.h"
#include "io/recording/scan_source.h"

namespace lamina {

class SerialMapping;

// Scans [next, end) of a source; the period of a sweep is learned from stamps from `begin` on.
struct ScanRange {
  std::size_t begin = 0, next = 0, end = 0;
};

// Not thread-safe.
class MappingPipeline {
 public:
  // `store` gets parts of the map that leave memory (VoxelMap). Throws OptionError.
  explicit MappingPipeline(const MappingOptions& options, MappingCallbacks callbacks = {},
                           VoxelStore* store = nullptr);
  ~MappingPipeline();

  // Maps scans that are there now; what is under way in the background stays so. Once `stop` is
  // true, scans that have been read are still processed. Returns the number of scans processed.
  std::size_t Process(const ScanSource& source, const ScanRange& range,
                      const std::atomic<bool>* stop = nullptr);
  // No more scans are to come: one last solve, then all poses are final.
  void Finish();

  // From now on scans are matched to the map and leave it as it is, the first one near this pose.
  void StartLocalising(const SE3& T_world_lidar);

  const MappingCounts& counts() const;
  // Poses of the scans that are not final, as known now.
  void ShowOpenPoses(const FinalPoses::Visit& visit) const;
  std::vector<Eigen::Vector3d> NewestKeyframe() const;
  const VoxelMap& map() const;
  VoxelMap& map();

  // Waits for the solve that takes effect before the next scan. Without that it may or may not
  // have: what is saved would depend on the speed of the threads, though not what comes of it.
  void Settle();
  // All of the state but the map; in on_settled or between two calls of Process(), after Settle().
  // Reading starts the solve again that was under way, and needs the map as it was.
  void Archive(StateArchive& a);

 private:
  class ScanStages;

  MappingOptions options_;
  std::unique_ptr<SerialMapping> serial_;
};

}  // namespace lamina
