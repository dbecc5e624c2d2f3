#include "tools/results/graph_file.h"

#include <fmt/format.h>

#include <optional>

#include "io/map/g2o_file.h"

namespace lamina {

std::string GraphFileName(std::int64_t frame) {
  return frame == 0 ? "graph.g2o" : fmt::format("graph_piece{}.g2o", frame);
}

AnchorGraph PartOfGraph(const AnchorGraph& graph, const std::vector<std::size_t>& poses) {
  AnchorGraph part;
  std::vector<std::optional<std::size_t>> place(graph.poses.size());
  for (const std::size_t i : poses) {
    place[i] = part.poses.size();
    part.poses.push_back(graph.poses[i]);
  }
  const auto take = [&](const std::vector<AnchorEdge>& edges, std::vector<AnchorEdge>* taken) {
    for (AnchorEdge edge : edges) {
      if (!place[edge.from] || !place[edge.to]) continue;
      edge.from = *place[edge.from];
      edge.to = *place[edge.to];
      taken->push_back(edge);
    }
  };
  take(graph.odometry, &part.odometry);
  take(graph.loops, &part.loops);
  part.kept_before.assign(part.loops.size(), true);
  return part;
}

void WriteAnchorGraph(const std::string& path, const AnchorGraph& graph) {
  G2oGraph file;
  file.poses = graph.poses;
  for (std::size_t i = 0; i < graph.poses.size(); ++i)
    file.ids.push_back(static_cast<std::int64_t>(i));
  for (const auto* edges : {&graph.odometry, &graph.loops}) {
    for (const AnchorEdge& edge : *edges)
      file.edges.push_back({edge.from, edge.to, edge.T_from_to, edge.information});
  }
  file.fixed = {0};
  WriteG2o(path, file);
}

}  // namespace lamina
