// What a session in a folder leaves for people and other commands: trajectories, frames.csv, the
// map, submaps, summary.json.
//
// Private to tools/watch.
#pragma once

#include "backend/session/session.h"
#include "config/config.h"
#include "tools/results/verdict/process_report.h"
#include "tools/results/verdict/verdict.h"

namespace lamina {

// `session` is finished; `figures` as far as the process alone knows them. Returns what
// summary.json says of the poses. Throws OutputError.
RunVerdict WriteSessionResults(const std::string& folder, const LaminaConfig& config,
                               RunFigures figures, std::size_t late_files, Session* session);

}  // namespace lamina
