#include "tools/results/piece_trajectories.h"

#include <fmt/format.h>

#include <filesystem>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "io/file/file_writer.h"
#include "io/map/trajectory_io.h"
#include "tools/metrics/match.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

void PutErrors(const TrajectoryErrors& errors, nlohmann::json* json) {
  (*json)["ape_rmse_m"] = NumberOrNull(errors.ape_rmse_m);
  (*json)["rpe_rmse_m"] = NumberOrNull(errors.rpe_rmse_m);
  (*json)["kitti_trel_percent"] = NumberOrNull(errors.kitti_trel_percent);
  (*json)["kitti_rrel_deg_per_m"] = NumberOrNull(errors.kitti_rrel_deg_per_m);
}

std::string DescribePair(const TrajectoryErrors& errors) {
  return fmt::format("APE {:.4f} m, RPE {:.4f} m (RMSE, SE(3)-aligned", errors.ape_rmse_m,
                     errors.rpe_rmse_m);
}

}  // namespace

std::string PieceTrajectoryName(std::int64_t piece) {
  return fmt::format("trajectory_tum_piece{}.txt", piece);
}

void WritePieceTrajectories(const std::string& folder,
                            const std::map<std::int64_t, PieceFigures>& pieces,
                            const std::function<void(const FinalPoses::Visit&)>& for_each) {
  RemovePieceFiles(folder, PieceTrajectoryName);
  if (pieces.size() < 2) return;
  // Files are open at once, so many at a time.
  constexpr std::size_t kAtOnce = 64;
  for (auto next = pieces.begin(); next != pieces.end();) {
    std::map<std::int64_t, FileWriter> writers;
    for (; next != pieces.end() && writers.size() < kAtOnce; ++next) {
      if (next->second.frames == 0) continue;
      writers.try_emplace(next->first,
                          (fs::path(folder) / PieceTrajectoryName(next->first)).string());
    }
    for_each([&](const FinalPose& pose) {
      const auto writer = writers.find(pose.piece);
      if (writer == writers.end() || pose.skipped) return;
      std::string line;
      AppendPoseLine(pose.pose, TrajectoryForm::kTum, &line);
      writer->second.Write(line);
    });
    for (auto& [piece, writer] : writers) writer.Commit();
  }
}

PieceErrors ComparePiecesWithTruth(const std::map<std::int64_t, Trajectory>& pieces,
                                   const Trajectory& truth) {
  PieceErrors errors;
  bool any = false;
  std::string problem = "there are no poses to compare with the truth";
  for (const auto& [piece, poses] : pieces) {
    const std::string name = pieces.size() > 1 ? fmt::format("piece {}", piece) : "the run";
    std::optional<TrajectoryErrors>& of_piece = errors[piece];
    try {
      of_piece = ErrorsOf(MatchPart({name, poses}, truth, kStampToleranceS), Alignment::kSe3);
      any = true;
    } catch (const InputError& error) {
      problem = error.what();
    }
  }
  if (!any) throw InputError(problem);
  return errors;
}

void AddErrors(const PieceErrors& errors, nlohmann::json* summary) {
  if (errors.size() == 1) return PutErrors(*errors.begin()->second, summary);
  (*summary)["compared_with_truth"] = "each piece by itself";
  for (nlohmann::json& piece : (*summary)["pieces"]) {
    const auto found = errors.find(piece["piece"].get<std::int64_t>());
    if (found != errors.end() && found->second) PutErrors(*found->second, &piece);
  }
}

std::string DescribePieceErrors(const PieceErrors& errors) {
  if (errors.size() == 1) {
    return fmt::format("against the truth: {})\n", DescribePair(*errors.begin()->second));
  }
  std::string text;
  for (const auto& [piece, of_piece] : errors) {
    text += of_piece ? fmt::format("piece {} against the truth: {}, by itself)\n", piece,
                                   DescribePair(*of_piece))
                     : fmt::format("piece {}: fewer than 2 of its poses match the truth\n", piece);
  }
  return text;
}

}  // namespace lamina
