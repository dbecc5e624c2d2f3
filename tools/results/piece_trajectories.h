// A trajectory file for each piece of the map, beside the one of all scans.
//
// trajectory_tum.txt has every scan that was not skipped, in order, whatever the frame that its
// pose is in. Where there is more than one piece, trajectory_tum_pieceN.txt has those of piece N
// alone, all in one frame: what other programs can take as it is.
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "backend/mapping/final_poses.h"
#include "tools/metrics/trajectory_metrics.h"
#include "tools/results/verdict/process_report.h"

namespace lamina {

std::string PieceTrajectoryName(std::int64_t piece);

// Writes them, and removes those of earlier runs; just that if there is but one piece. `for_each`
// is called more than once. Throws OutputError.
void WritePieceTrajectories(const std::string& folder,
                            const std::map<std::int64_t, PieceFigures>& pieces,
                            const std::function<void(const FinalPoses::Visit&)>& for_each);

// The errors of each piece, aligned and judged by itself; nothing for a piece of which fewer than
// two poses are known truly.
using PieceErrors = std::map<std::int64_t, std::optional<TrajectoryErrors>>;

// With the true poses of the scans (ReadTruthOfPart). Throws InputError if not one piece can be
// judged.
PieceErrors ComparePiecesWithTruth(const std::map<std::int64_t, Trajectory>& pieces,
                                   const Trajectory& truth);

// Into summary.json: errors of the only piece at the top, else of each within `pieces`.
void AddErrors(const PieceErrors& errors, nlohmann::json* summary);
// A line for each piece.
std::string DescribePieceErrors(const PieceErrors& errors);

}  // namespace lamina
