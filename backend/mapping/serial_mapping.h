// The serial stage of mapping: everything that depends on the order of the scans.
//
// A recording (the scans of one clock and one sensor: a folder of the inbox) has odometry, window
// and open solve of its own, so scans of several may alternate and each gets the poses that it
// would get alone. It begins a piece of the map (VoxelMap), and another one when it was lost for
// too long: nothing is known of where one piece lies in the frame of another, and nothing of one is
// matched to another or drawn over it. (Localising, all recordings are matched to the map that is
// there, from the same start.)
//
// The number of recordings under way is bounded: when one more comes, the one that was silent
// longest is ended, and what comes of it later begins a new piece.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "backend/mapping/final_poses.h"
#include "backend/mapping/options.h"
#include "backend/mapping/piece_mapper.h"
#include "backend/mapping/report.h"
#include "core/geometry/state_archive.h"
#include "core/map/voxel_map.h"

namespace lamina {

// Not thread-safe.
class SerialMapping {
 public:
  SerialMapping(const MappingOptions& options, MappingCallbacks callbacks, VoxelStore* store);

  // The next scan; the report is completed.
  void Process(ScanReport* report, std::vector<TimedCluster>* clusters);
  void StartLocalising(const SE3& T_world_lidar) { localise_from_ = T_world_lidar; }
  // One last solve of every recording under way, then all poses are final.
  void Finish();

  void ShowOpenPoses(const FinalPoses::Visit& visit) const;
  // Of the recording that the last scan was of.
  std::vector<Eigen::Vector3d> NewestKeyframe() const;
  const MappingCounts& counts() const { return counts_; }
  const VoxelMap& map() const { return map_; }
  VoxelMap& map() { return map_; }

  // See MappingPipeline.
  void Settle();
  void Archive(StateArchive& a);

 private:
  struct Recording {
    bool any = false;  // scan that was not skipped
    StampNs last_stamp_ns = 0;
    std::string last_sensor;
    std::int64_t last_scan = 0;  // skipped or not
    std::unique_ptr<PieceMapper> mapper;
  };

  // Null if the map has no room for another piece.
  Recording* FindOrBegin(const ScanReport& report);
  std::unique_ptr<PieceMapper> BeginPiece(const SE3& T_world_start);
  void EndLongestSilent(std::size_t scan);
  void End(PieceMapper* mapper, std::size_t scan);
  static void CheckStamp(const Recording& recording, ScanReport* report);
  void Map(Recording* recording, ScanReport* report, std::vector<TimedCluster>* clusters);
  MappedFrame Register(Recording* recording, ScanReport* report,
                       std::vector<TimedCluster>* clusters);
  void SolveSilent(std::size_t scan);
  void HandOnFinalPoses(std::size_t scan);
  void CountSolves(std::vector<SolveReport> solves, std::size_t before_scan);
  FinalPoses::Visit Visitor() const;

  const MappingOptions& options_;
  MappingCallbacks callbacks_;
  VoxelMap map_;
  MappingCounts counts_;
  FinalPoses poses_;
  std::optional<SE3> localise_from_;
  FinalPoses::Stream next_stream_ = 0;
  std::string newest_;  // recording
  std::map<std::string, Recording> recordings_;
};

}  // namespace lamina
