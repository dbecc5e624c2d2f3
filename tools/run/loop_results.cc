#include "tools/run/loop_results.h"

#include <fmt/format.h>

#include <filesystem>
#include <map>

#include "io/file/file_writer.h"
#include "io/file/g2o_file.h"
#include "tools/results/process_report.h"

namespace lamina {
namespace {

G2oGraph FileOf(const AnchorGraph& graph) {
  G2oGraph file;
  file.poses = graph.poses;
  for (std::size_t i = 0; i < graph.poses.size(); ++i)
    file.ids.push_back(static_cast<std::int64_t>(i));
  for (const auto* edges : {&graph.odometry, &graph.loops}) {
    for (const AnchorEdge& edge : *edges)
      file.edges.push_back({edge.from, edge.to, edge.T_from_to, edge.information});
  }
  file.fixed = {0};
  return file;
}

std::string Row(std::int64_t piece, const LoopClosure& closure, const Loop& loop) {
  const SE3& T = loop.match.T_other_query;
  const auto stamp = [&](std::size_t submap) {
    return closure.submaps()[submap].keyframes.front().stamp_ns;
  };
  return fmt::format(
      "{},{},{},{},{},{},{},{:.6f},{:.3f},{},{:.4f},{:.4f},{:.4f},{:.3f},"
      "{:.6f},{:.6f},{:.6f},{:.9f},{:.9f},{:.9f},{:.9f}\n",
      piece, loop.from, loop.to, stamp(loop.from), stamp(loop.to), ToString(loop.status),
      loop.reason, loop.score, loop.way_m, loop.match.planes, loop.match.overlap,
      loop.match.structure, loop.match.residual_sigmas, loop.match.facing, T.t.x(), T.t.y(),
      T.t.z(), T.q.x(), T.q.y(), T.q.z(), T.q.w());
}

}  // namespace

std::string GraphFileName(std::int64_t piece) {
  return piece == 0 ? "graph.g2o" : fmt::format("graph_piece{}.g2o", piece);
}

void WriteLoopFiles(const std::string& folder, const PieceLoops& loops) {
  RemovePieceFiles(folder, GraphFileName);
  FileWriter table((std::filesystem::path(folder) / "loops.csv").string());
  table.Write(
      "piece,from,to,from_stamp_ns,to_stamp_ns,status,reason,score,way_m,planes,overlap,structure,"
      "residual_sigmas,facing,x,y,z,qx,qy,qz,qw\n");
  for (const auto& [piece, closure] : loops.pieces()) {
    for (const Loop& loop : closure->loops()) table.Write(Row(piece, *closure, loop));
    if (!closure->submaps().empty()) {
      WriteG2o((std::filesystem::path(folder) / GraphFileName(piece)).string(),
               FileOf(closure->graph()));
    }
  }
  table.Commit();
}

nlohmann::json LoopSummary(const PieceLoops& loops) {
  std::size_t submaps = 0, leaves = 0, accepted = 0, waiting = 0;
  std::map<std::string, std::size_t> refused;
  nlohmann::json pieces = nlohmann::json::array();
  for (const auto& [piece, closure] : loops.pieces()) {
    submaps += closure->submaps().size();
    for (const Submap& submap : closure->submaps()) leaves += submap.leaves.size();
    for (const Loop& loop : closure->loops()) {
      accepted += loop.status == Loop::Status::kAccepted ? 1 : 0;
      waiting += loop.status == Loop::Status::kWaiting ? 1 : 0;
      if (loop.status == Loop::Status::kRefused) ++refused[loop.reason];
    }
    double most = 0.0;
    for (std::size_t i = 0; i < closure->submaps().size(); ++i) {
      most =
          std::max(most, (closure->anchors()[i].t - closure->submaps()[i].T_world_submap.t).norm());
    }
    pieces.push_back({{"piece", piece},
                      {"submaps", closure->submaps().size()},
                      {"cost_before", closure->cost_before()},
                      {"cost", closure->cost()},
                      {"largest_correction_m", most}});
  }
  return {{"submaps", submaps},           {"submap_bytes", leaves * sizeof(SubmapLeaf)},
          {"accepted", accepted},         {"waiting", waiting},
          {"refused_by_reason", refused}, {"pieces", pieces}};
}

}  // namespace lamina
