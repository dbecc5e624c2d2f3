// Loop closure of one piece while it is mapped.
//
//     keyframe leaves the window -> SubmapBuilder -> a submap is complete
//       -> LoopClosure::Add, in the background, beside odometry
//       -> loops.hand_over_lag_keyframes later its correction takes effect
//
// Two frames:
//
//     world  that of odometry: poses of mapping, velocity, window and the map that scans are
//            matched to live in it. It never jumps, and drifts.
//     map    that of the corrected anchors. It coincides with `world` until a loop is accepted.
//
// The newest complete submap joins them, T_map_world = T_map_submap T_world_submap^-1, and keeps
// its place in `world`. When anchors have moved, all others get a new place beside it,
//
//     T_world_other = T_map_world^-1 T_map_other,
//
// and the fixed part of the map is put together anew from those within loops.reach_m of the sensor
// (map_assembly.h) and from the submap that is not complete yet. So no pose jumps, and scans of
// a street that was driven before are matched to what was seen then.
//
// Until a loop is accepted nothing of this touches the map. What takes effect when is decided by
// counting keyframes: the same bits at any number of threads. Poses are corrected by their stamps,
// which ascend within a piece. Not thread-safe.
#pragma once

#include <optional>
#include <vector>

#include "backend/loops/loop_closure.h"
#include "backend/submaps/map_assembly.h"
#include "core/base/parallel.h"

namespace lamina {

class LoopTrack {
 public:
  // Throws OptionError. `store` gets the leaves of submaps that are complete, which then leave
  // memory; null: they stay.
  LoopTrack(const LoopOptions& options, const VoxelMapOptions& map,
            const ScanMatcherOptions& matcher, ByteStore* store = nullptr);

  // The next keyframe that has left the window.
  void Add(const FinalKeyframe& keyframe);
  // Between two scans: takes in what is due and begins what is to be done. What the fixed part of
  // the map is to be exchanged for now, if it is.
  std::optional<std::vector<VoxelMap::FixedPart>> Advance();
  // No more keyframes are to come; all corrections are in effect then, but for the map's.
  void Finish();

  // After Finish(): keyframes are to come again, of a sensor that was found at this place of
  // `world`. What the fixed part of the map is to be exchanged for, if it is.
  std::optional<std::vector<VoxelMap::FixedPart>> Resume(const Eigen::Vector3d& sensor);

  // The stamp of the last keyframe, 0 before the first.
  StampNs last_ns() const { return last_ns_; }
  // By the corrections that are in effect. Identity until there is one.
  const SE3& T_map_world() const { return T_map_world_; }
  // Pose T_map_lidar of a scan whose pose in `world` is final. The same pose until there is a
  // correction.
  SE3 Corrected(StampNs stamp_ns, const SE3& T_world_lidar) const;
  // What does that; empty until there is a correction. `corrections` counts its changes.
  const std::optional<AnchorCorrection>& correction() const { return correction_; }
  std::int64_t corrections() const { return corrections_; }

  // Waits for what is under way.
  const LoopClosure& closure() const;

  // Where its store has the leaves of submaps. Waits for what is under way.
  void AddStoredPlaces(std::vector<StoredBytes>* places) const;

  // Between two scans, after Advance(). Waits for what is under way; reading starts anew what it
  // has led to.
  void Archive(StateArchive& a);

 private:
  void Begin();
  void Settle();
  std::vector<PlacedSubmap> Within(const SE3& T_world_map, const Eigen::Vector3d& sensor) const;
  bool Stands(const std::vector<PlacedSubmap>& wanted) const;
  std::vector<VoxelMap::FixedPart> TakeIn();
  void TakeInAll();

  // Of the mapping thread: what is stored, and where, follows from the scans alone.
  void Complete(Submap submap);

  LoopOptions options_;
  VoxelMapOptions map_;
  ByteStore* store_;
  SubmapBuilder builder_;
  LoopClosure closure_;
  std::vector<Submap> complete_;  // wait to be begun with
  Eigen::Vector3d sensor_ = Eigen::Vector3d::Zero(), sensor_at_begin_ = Eigen::Vector3d::Zero();
  StampNs last_ns_ = 0;
  int keyframes_since_begin_ = 0;

  // In effect.
  SE3 T_map_world_;
  std::optional<AnchorCorrection> correction_;
  std::int64_t corrections_ = 0;
  // Submaps of which the fixed part of the map was put together; those after them are in it as they
  // were mapped.
  struct Attached {
    std::int64_t id = 0;
    SE3 T_world_submap;

    void Archive(StateArchive& a) { a(&id, &T_world_submap); }
  };
  std::vector<Attached> attached_;

  // Under way; of the background thread.
  struct Outcome {
    bool exchange = false;
    SE3 T_map_world;
    std::optional<AnchorCorrection> correction;
    std::vector<Attached> attached;
    std::vector<VoxelMap::FixedPart> parts;
  };
  bool under_way_ = false;
  std::vector<Submap> working_on_;
  Outcome outcome_;
  mutable Background background_;  // the last member: it waits before what it works on goes
};

}  // namespace lamina
