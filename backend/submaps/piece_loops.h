// Loop closure beside mapping: submaps of each piece from its final keyframes, and the correction
// of its poses and map.
//
//     MappingCallbacks callbacks;
//     callbacks.on_final_keyframe = [&](auto piece, const auto& k) { loops.Add(piece, k); };
//     ... map, Finish() ...
//     loops.Finish();
//     pose = loops.Corrected(final_pose);   loops.AddCorrectedTo(&map);
//
// Loops are looked for as submaps are completed; what comes of them changes nothing of the mapping
// under way. Not thread-safe; the same bits at any number of threads.
#pragma once

#include <cstdint>
#include <map>
#include <memory>

#include "backend/mapping/final_poses.h"
#include "backend/mapping/mapper.h"
#include "backend/submaps/loop_closure.h"

namespace lamina {

class PieceLoops {
 public:
  // Throws OptionError.
  PieceLoops(const LoopOptions& options, const MapperOptions& mapping);

  void Add(std::int64_t piece, const FinalKeyframe& keyframe);
  // No more keyframes are to come.
  void Finish();

  // Whether any loop was accepted: if not, nothing is corrected.
  bool AnyAccepted() const;
  const std::map<std::int64_t, std::unique_ptr<LoopClosure>>& pieces() const { return closures_; }

  // After Finish(): the pose, moved with its submap.
  SE3 Corrected(const FinalPose& pose) const;
  // After Finish(): all submaps at their anchors, into an empty map.
  void AddCorrectedTo(VoxelMap* map) const;

 private:
  LoopOptions options_;
  MapperOptions mapping_;
  std::map<std::int64_t, SubmapBuilder> builders_;
  std::map<std::int64_t, std::unique_ptr<LoopClosure>> closures_;
  std::map<std::int64_t, AnchorCorrection> corrections_;
};

}  // namespace lamina
