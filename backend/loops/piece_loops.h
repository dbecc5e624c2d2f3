// Loop closure of all pieces of a mapping: a LoopTrack each, and their corrected poses and map.
//
// Not thread-safe; the same bits at any number of threads.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <vector>

#include "backend/loops/loop_track.h"

namespace lamina {

// The corrections of all pieces at one moment.
struct PieceCorrections {
  std::map<std::int64_t, AnchorCorrection> pieces;

  // Pose T_map_lidar of a scan whose pose in the frame of its piece's odometry is final.
  SE3 Corrected(std::int64_t piece, StampNs stamp_ns, const SE3& T_world_lidar) const;
};

class PieceLoops {
 public:
  // Throws OptionError. `map`, `matcher`: as in mapping; `store`: as of LoopTrack.
  PieceLoops(const LoopOptions& options, const VoxelMapOptions& map,
             const ScanMatcherOptions& matcher, ByteStore* store = nullptr);

  // That of a piece, made if it is not there.
  LoopTrack* Track(std::int64_t piece);
  // Null before its first keyframe.
  const LoopTrack* Find(std::int64_t piece) const;
  // Those of lower numbers that have a keyframe, and all of theirs before that time.
  std::vector<std::int64_t> PiecesBefore(std::int64_t piece, StampNs stamp_ns) const;
  // No more keyframes are to come.
  void Finish();

  // The number of the next keyframe of a piece whose track is finished.
  std::int64_t NextKeyframe(std::int64_t piece) const;

  // Waits for what is under way.
  std::map<std::int64_t, const LoopClosure*> pieces() const;

  // Pose T_map_lidar as known now of a scan whose pose in the frame of its piece's odometry is
  // final.
  SE3 Corrected(std::int64_t piece, StampNs stamp_ns, const SE3& T_world_lidar) const;
  // What does that, for other threads; how often it has changed.
  PieceCorrections Corrections() const;
  std::int64_t corrections() const;
  // After Finish(): all submaps at their anchors, into an empty map.
  void AddCorrectedTo(VoxelMap* map) const;

  // Where the store has what the submaps of now need. Waits for what is under way.
  std::vector<StoredBytes> StoredPlaces() const;

  // Between two scans. What is in the store is not in the archive: reading needs a store that has
  // it, and takes it back to how it was then. Throws InputError if it has not.
  void Archive(StateArchive& a);

 private:
  LoopOptions options_;
  VoxelMapOptions map_;
  ScanMatcherOptions matcher_;
  ByteStore* store_;
  std::map<std::int64_t, std::unique_ptr<LoopTrack>> tracks_;
};

}  // namespace lamina
