// Drives of one place as one map: their pieces joined (backend/loops/piece_joining.h), then
// adjusted together (backend/submaps/submap_bundle.h).
//
// With more effort, all pairs of submaps that then overlap are compared in between
// (backend/loops/map_refinement.h), and the adjustment takes more rounds.
//
// What is joined lies in one frame, that of its oldest submap; frames are numbered from 0, the
// oldest first.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <utility>
#include <vector>

#include "backend/loops/piece_joining.h"
#include "backend/submaps/submap_bundle.h"
#include "tools/merge/drive.h"

namespace lamina {

class MergedMap {
 public:
  // Drives sorted by age, one at least; they must outlive it. Throws InputError if their submaps
  // have leaves of different sizes.
  enum class Effort { kJoin, kAllPairs };
  // What is told of the work with more effort, and what it goes on from; all may be left out.
  struct Work {
    // Pairs that were compared, and that are known to be due.
    std::function<void(std::size_t, std::size_t)> on_pairs;
    SubmapBundleWork bundle;  // its journal keeps the pairs, too
  };
  MergedMap(const std::vector<Drive>& drives, const LaminaConfig& config,
            Effort effort = Effort::kJoin, const Work& work = {}, const WorkSharing& sharing = {});

  std::size_t frames() const { return members_.size(); }
  // Positions in graph() of a frame's submaps.
  const std::vector<std::size_t>& SubmapsOfFrame(std::size_t frame) const {
    return members_[frame];
  }
  const AnchorGraph& graph() const { return joined_.graph; }
  const std::vector<Loop>& loops() const { return joined_.loops; }
  const SubmapBundleResult& bundle() const { return bundle_; }

  struct Origin {
    std::size_t drive = 0;
    std::int64_t piece = 0;
    const Submap* submap = nullptr;
  };
  const Origin& origin(std::size_t submap) const { return origins_[submap]; }

  // The number of a drive's piece among those of all drives, frame by frame.
  // Of a frame's pieces, by their numbers; holders are positions in SubmapsOfFrame().
  FrameTrimmings TrimmedOfFrame(std::size_t frame) const;
  std::int64_t PieceNumber(std::size_t drive, std::int64_t piece) const {
    return numbers_.at({drive, piece});
  }

  struct Posed {
    std::size_t frame = 0;
    std::int64_t piece = 0;  // its number among those of all drives
    const DrivePose* pose = nullptr;
    SE3 T_frame_lidar;
  };
  // The poses of a drive; those of pieces without a submap are left out.
  std::vector<Posed> PosesOf(std::size_t drive) const;

  // The poses of the keyframes of each submap, as PosesOf has those of scans.
  std::vector<std::vector<SE3>> KeyframePoses() const;
  // Moves keyframes, from those poses to these: submaps are made anew of their clusters, which
  // read(submap, keyframe of it) returns, and anchors and poses follow.
  using ReadClusters = std::function<std::vector<PackedCluster>(std::size_t, std::size_t)>;
  void MoveKeyframes(const std::vector<std::vector<SE3>>& from,
                     const std::vector<std::vector<SE3>>& to, const ReadClusters& read);

  // All submaps of all frames, each a piece of the map.
  void AddTo(VoxelMap* map) const;

 private:
  void AddOrigins();
  void Refine(const std::vector<const Submap*>& submaps, const LaminaConfig& config,
              const Work& work);
  void NumberFrames();
  void CorrectDrives();

  const std::vector<Drive>& drives_;
  std::vector<std::pair<std::size_t, std::size_t>> parts_;  // drive, and which of its frames
  JoinedPieces joined_;
  SubmapBundleResult bundle_;
  std::vector<Origin> origins_;
  std::vector<std::size_t> frame_of_;              // of each submap
  std::vector<std::vector<std::size_t>> members_;  // of each frame
  // Of each piece of each drive.
  std::map<std::pair<std::size_t, std::int64_t>, AnchorCorrection> corrections_;
  // After those, where keyframes have been moved.
  std::map<std::pair<std::size_t, std::int64_t>, AnchorCorrection> keyframe_corrections_;
  std::vector<Submap> moved_;  // what origins_ point to then
  std::map<std::pair<std::size_t, std::int64_t>, std::size_t> frame_of_piece_;
  std::map<std::pair<std::size_t, std::int64_t>, std::int64_t> numbers_;
};

}  // namespace lamina
