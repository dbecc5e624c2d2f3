// A drive to be merged: the output folder of `lamina run --loops on`.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "config/config.h"
#include "core/geometry/scan.h"
#include "tools/results/submap_file.h"

namespace lamina {

// A pose of trajectory_tum.txt.
struct DrivePose {
  StampedPose pose;
  std::int64_t piece = 0;
  std::string status;  // as in frames.csv
};

struct Drive {
  std::string folder;
  LaminaConfig config;
  std::vector<SubmapFrame> frames;
  std::vector<DrivePose> poses;
};

// Throws InputError: no such folder, without submaps (a run without loops), or with files that do
// not belong together.
Drive ReadDrive(const std::string& folder);

// Sorts drives, and the frames of each, by their age: the stamp of the first keyframe, then what is
// in them, so that the order in which they are named decides nothing.
void SortByAge(std::vector<Drive>* drives);

}  // namespace lamina
