// What a run with loop closure tells of its submaps: loops.csv, the pose graphs, summary.json.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "tools/run/joined_run.h"

namespace lamina {

// In the run's folder: loops.csv, a line for each pair of submaps that was compared, and the graph
// of each frame, graph.g2o or graph_pieceN.g2o: the submaps of its first piece, then those of the
// pieces that were joined to it. Those of an earlier run are removed. Throws OutputError.
void WriteLoopFiles(const std::string& folder, const JoinedRun& run);

// For summary.json: submaps, loops accepted, waiting and refused by reason, pieces joined, costs.
nlohmann::json LoopSummary(const JoinedRun& run);

}  // namespace lamina
