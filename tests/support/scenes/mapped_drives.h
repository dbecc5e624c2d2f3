// Drives through a town (submap_town.h), mapped as submaps with loops: pieces to be joined.
#pragma once

#include <cstdint>
#include <memory>
#include <utility>
#include <vector>

#include "backend/loops/loop_closure.h"
#include "tests/support/scenes/submap_town.h"

namespace lamina {

// Its world is the frame of its first LiDAR pose.
struct MappedDrive {
  std::vector<SE3> truth;  // of the keyframes
  Trajectory odometry;
  std::unique_ptr<LoopClosure> loops;
};

inline LoopOptions DriveLoopOptions() {
  LoopOptions options;
  options.enabled = true;
  options.min_way_m = 40.0;
  return options;
}

// Odometry turns a little too far at every step.
inline MappedDrive MapDrive(const Town& town, const std::vector<SE3>& drive, unsigned seed,
                            double turn_rad = 0.0004, StampNs start_ns = 0) {
  constexpr double kLeafM = 0.8;
  MappedDrive mapped;
  mapped.truth = drive;
  Draws draws(seed);
  SubmapBuilder builder(DriveLoopOptions().submap, kLeafM);
  mapped.loops =
      std::make_unique<LoopClosure>(DriveLoopOptions(), VoxelMapOptions(), ScanMatcherOptions());
  SE3 T;
  for (std::size_t i = 0; i < drive.size(); ++i) {
    if (i > 0)
      T = T * (drive[i - 1].Inverse() * drive[i]) * SE3(ExpSO3({0, 0, turn_rad}), {0, 0, 0});
    FinalKeyframe keyframe =
        KeyframeOf(town, static_cast<std::int64_t>(i), drive[i], T, kLeafM, &draws);
    keyframe.stamp_ns += start_ns;
    mapped.odometry.push_back({keyframe.stamp_ns, T});
    if (auto submap = builder.Add(keyframe)) mapped.loops->Add(std::move(*submap));
  }
  mapped.loops->Add(*builder.Finish());
  return mapped;
}

}  // namespace lamina
