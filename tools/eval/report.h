// Figures of an evaluation as text for a reader and as JSON for a program. Both name what was
// averaged and how the trajectories were aligned. Figures that do not exist (no segment is long
// enough, no voxel counts) are "-" in the text and null in the JSON.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "tools/metrics/map_quality.h"
#include "tools/metrics/trajectory_metrics.h"

namespace lamina {

std::string DescribeAlignment(Alignment alignment);

// Several lines, each ended.
std::string DescribeErrors(const TrajectoryErrors& errors, Alignment alignment);
std::string DescribeMapQuality(const MapQualityReport& report, const MapQualityOptions& options);

// Keys carry units, e.g. "ape_rmse_m", "kitti_trel_percent".
nlohmann::json ToJson(const TrajectoryErrors& errors, Alignment alignment);
nlohmann::json ToJson(const MapQualityReport& report, const MapQualityOptions& options);

}  // namespace lamina
