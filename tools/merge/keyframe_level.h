// A merged map adjusted once more, by its keyframes (backend/tiles/keyframe_bundle.h): each frame
// of it by itself. Then its submaps are made anew of their keyframes, and its anchors and poses
// follow.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "backend/submaps/work_sharing.h"
#include "backend/tiles/keyframe_bundle.h"
#include "tools/merge/merged_map.h"
#include "tools/results/keyframe_file.h"

namespace lamina {

struct KeyframeLevelOptions {
  KeyframeBundleOptions bundle;
  std::string scratch;  // folder for files that outgrow memory
};

// Throws InputError if a drive has no keyframes.bin, or one that does not belong to its submaps.
// All processes of `sharing` call it together; only the first has the map moved then. Returns what
// became of each frame.
std::vector<KeyframeBundleResult> AdjustKeyframesOf(const std::vector<Drive>& drives,
                                                    const LaminaConfig& config,
                                                    const KeyframeLevelOptions& options,
                                                    const WorkSharing& sharing, MergedMap* merged);

// For summary.json.
nlohmann::json ToJson(const std::vector<KeyframeBundleResult>& frames);

}  // namespace lamina
