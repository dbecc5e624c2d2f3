#include "tools/watch/session_results.h"

#include <spdlog/spdlog.h>

#include <filesystem>
#include <set>

#include "backend/loops/piece_loops.h"
#include "tools/cli/common.h"
#include "tools/results/piece_trajectories.h"
#include "tools/results/submap_file.h"

namespace lamina {

RunVerdict WriteSessionResults(const std::string& folder, const LaminaConfig& config,
                               RunFigures figures, std::size_t late_files, Session* session) {
  const auto path = [&](const char* name) {
    return (std::filesystem::path(folder) / name).string();
  };
  const Mapping& mapping = session->mapping();
  FrameTable table(path("frames.csv"), config.frontend.matcher.max_iterations);
  std::set<std::int64_t> given_up;
  for (const FinalPose& pose : session->tail()) {
    if (pose.given_up) given_up.insert(static_cast<std::int64_t>(pose.scan));
  }
  session->database().ForEach(0, session->next_scan(), [&](ScanRecord row) {
    if (given_up.count(row.scan) > 0) row.GiveUp();
    table.Append(row);
  });
  table.Commit();
  WritePieceTrajectories(folder, table.pieces(),
                         [&](const FinalPoses::Visit& visit) { session->ForEachPose(visit); });
  if (const PieceLoops* const loops = mapping.loops(); loops != nullptr)
    WriteSubmaps(path(kSubmapFileName), FramesOf(loops->pieces()));
  figures.map_surfels = WriteMap(
      folder, mapping.map(), LeastSurfelFrames(config.backend.min_surfel_frames, mapping.counts()));
  figures.map_over_budget = mapping.map().over_budget();
  nlohmann::json summary = Summarise(mapping.counts(), mapping.map(), figures);
  summary["pieces"] = ToJson(table.pieces());
  const RunVerdict verdict = table.Judge();
  summary["verdict"] = ToJson(verdict);
  summary["late_files"] = late_files;
  summary["stored_voxels"] = session->stored_roots();
  WriteTextFile(path("summary.json"), SummaryText(summary));
  spdlog::info("verdict: {}", ToString(verdict));
  spdlog::info("{} frames mapped in all; trajectory, map and figures are in {}",
               mapping.counts().frames, folder);
  return verdict;
}

}  // namespace lamina
