// What a run with loop closure tells of its submaps: loops.csv, the pose graphs, summary.json.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "backend/submaps/piece_loops.h"

namespace lamina {

// In the run's folder: loops.csv, a line for each pair of submaps that was compared, and the graph
// of each piece, graph.g2o or graph_pieceN.g2o. Those of an earlier run are removed. Throws
// OutputError.
void WriteLoopFiles(const std::string& folder, const PieceLoops& loops);

std::string GraphFileName(std::int64_t piece);

// For summary.json: submaps, loops accepted, waiting and refused by reason, costs.
nlohmann::json LoopSummary(const PieceLoops& loops);

}  // namespace lamina
