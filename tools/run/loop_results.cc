#include "tools/run/loop_results.h"

#include <fmt/format.h>

#include <filesystem>
#include <map>
#include <vector>

#include "io/file/file_writer.h"
#include "tools/results/graph_file.h"
#include "tools/results/loop_evidence.h"
#include "tools/results/verdict/process_report.h"

namespace lamina {
namespace {

// A submap by its number within its piece.
struct PieceSubmap {
  std::int64_t piece = 0;
  std::size_t number = 0;
  StampNs stamp_ns = 0;
};

std::string Row(const PieceSubmap& from, const PieceSubmap& to, const Loop& loop) {
  return fmt::format("{},{},{},{},{},{},{},{:.6f},{:.3f},{},{}\n", from.piece, from.number,
                     to.number, from.stamp_ns, to.stamp_ns, ToString(loop.status), loop.reason,
                     loop.score, loop.way_m, LoopEvidence(loop.match), to.piece);
}

// Counts of loops by what became of them.
struct LoopCounts {
  std::size_t accepted = 0, waiting = 0;
  std::map<std::string, std::size_t> refused;
  void Add(const std::vector<Loop>& loops) {
    for (const Loop& loop : loops) {
      accepted += loop.status == Loop::Status::kAccepted ? 1 : 0;
      waiting += loop.status == Loop::Status::kWaiting ? 1 : 0;
      if (loop.status == Loop::Status::kRefused) ++refused[loop.reason];
    }
  }
};

}  // namespace

void WriteLoopFiles(const std::string& folder, const JoinedRun& run) {
  RemovePieceFiles(folder, GraphFileName);
  FileWriter table((std::filesystem::path(folder) / "loops.csv").string());
  table.Write(
      fmt::format("piece,from,to,from_stamp_ns,to_stamp_ns,status,reason,score,way_m,{},to_piece\n",
                  kLoopEvidenceColumns));
  const auto submap = [&](std::int64_t piece, std::size_t number) {
    return PieceSubmap{piece, number,
                       run.pieces().at(piece)->submaps()[number].keyframes.front().stamp_ns};
  };
  for (const auto& [piece, closure] : run.pieces()) {
    for (const Loop& loop : closure->loops())
      table.Write(Row(submap(piece, loop.from), submap(piece, loop.to), loop));
    if (run.FrameOf(piece) == piece && !closure->submaps().empty()) {
      WriteAnchorGraph((std::filesystem::path(folder) / GraphFileName(piece)).string(),
                       PartOfGraph(run.joined().graph, run.SubmapsOfFrame(piece)));
    }
  }
  for (const Loop& loop : run.joined().loops) {
    table.Write(Row(submap(run.PieceOfSubmap(loop.from), run.NumberInPiece(loop.from)),
                    submap(run.PieceOfSubmap(loop.to), run.NumberInPiece(loop.to)), loop));
  }
  table.Commit();
}

nlohmann::json LoopSummary(const JoinedRun& run) {
  std::size_t submaps = 0, trimmed = 0, leaves = 0;
  LoopCounts counts, between;
  between.Add(run.joined().loops);
  counts.Add(run.joined().loops);
  nlohmann::json pieces = nlohmann::json::array();
  for (const auto& [piece, closure] : run.pieces()) {
    submaps += closure->submaps().size();
    trimmed += closure->trimmed().size();
    for (const Submap& submap : closure->submaps()) leaves += submap.LeafCount();
    counts.Add(closure->loops());
    double most = 0.0;
    for (std::size_t i = 0; i < closure->submaps().size(); ++i) {
      most =
          std::max(most, (closure->anchors()[i].t - closure->submaps()[i].T_world_submap.t).norm());
    }
    pieces.push_back({{"piece", piece},
                      {"frame", run.FrameOf(piece)},
                      {"submaps", closure->submaps().size()},
                      {"cost_before", closure->cost_before()},
                      {"cost", closure->cost()},
                      {"largest_correction_m", most}});
  }
  return {{"submaps", submaps},
          {"trimmed_submaps", trimmed},
          {"submap_bytes", leaves * sizeof(SubmapLeaf)},
          {"accepted", counts.accepted},
          {"accepted_between_pieces", between.accepted},
          {"waiting", counts.waiting},
          {"refused_by_reason", counts.refused},
          {"pieces_joined", run.joins().size()},
          {"bundle",
           {{"rounds", run.bundle().rounds},
            {"planes", run.bundle().planes},
            {"largest_move_m", run.bundle().largest_move_m},
            {"refusal", run.bundle().refusal}}},
          {"pieces", pieces}};
}

}  // namespace lamina
