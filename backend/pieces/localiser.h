// Finding a sensor in a map that stays as it is, one scan after the other: a Mapper without a
// window.
//
// Nothing adjusts its poses, so each is final at once. They are in the frame of the piece.
#pragma once

#include <cstdint>

#include "backend/pieces/mapper_options.h"
#include "backend/pieces/scan_tracker.h"
#include "core/geometry/scan.h"
#include "core/geometry/state_archive.h"
#include "core/map/voxel_map.h"

namespace lamina {

// Not thread-safe; deterministic.
class Localiser {
 public:
  // `piece` must be one of the map's, which must outlive this. Before any scan: Start or Archive.
  Localiser(const MapperOptions& options, VoxelMap* map, std::int64_t piece);

  // The first scan is near this pose. However long it is lost, it begins no piece of its own.
  void Start(const SE3& T_world_lidar);
  // Goes on from these last scans, in which the sensor was found in the map. When it is lost for
  // long, a scan is to begin a piece of its own.
  void Start(const Trajectory& last);

  // Clusters are left as they are. The pose of the first scan is as uncertain as its speed. Without
  // `may_restart` a frame is lost however many were before.
  RegisteredScan Process(const MapperScan& scan, bool may_restart = true);
  // Poses of the frames since the last call, at their stamps.
  Trajectory TakeFinal();
  // The same, without taking them.
  const Trajectory& final_poses() const { return final_; }

  std::int64_t piece() const { return piece_; }

  // All but the map and the piece's number.
  void Archive(StateArchive& a);

 private:
  VoxelMap* map_;
  std::int64_t piece_;
  ScanTracker tracker_;
  MotionOptions motion_;
  bool may_restart_ = true;  // when it is lost for long
  Trajectory final_;
};

}  // namespace lamina
