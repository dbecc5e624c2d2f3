// What `lamina merge` leaves in its folder.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tools/merge/merged_map.h"

namespace lamina {

// Poses of a drive, in the order of the drives.
std::string DriveTrajectoryName(std::size_t drive);

// All files but summary.json, and returns that. Throws OutputError.
nlohmann::json WriteMerge(const std::string& folder, const std::vector<Drive>& drives,
                          const MergedMap& merged, const LaminaConfig& config);

}  // namespace lamina
