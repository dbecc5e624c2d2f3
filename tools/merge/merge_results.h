// What `lamina merge` leaves in its folder.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tools/merge/merged_map.h"

namespace lamina {

// The file of a drive's poses.
std::string DriveTrajectoryName(std::int64_t drive);

// All files but summary.json, and returns that. Throws OutputError.
nlohmann::json WriteMerge(const std::string& folder, const std::vector<Drive>& drives,
                          const MergedMap& merged, const LaminaConfig& config);

}  // namespace lamina
