#include "tools/graph/command.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "backend/anchors/anchor_graph.h"
#include "core/base/error.h"
#include "core/base/stopwatch.h"
#include "io/map/g2o_file.h"

namespace lamina {
namespace {

struct GraphArguments {
  std::string graph, out;
  bool robust = false;
  int max_iterations = 200;
};

// Edges between successive ids are odometry, which is taken for right.
bool IsOdometry(const G2oGraph& file, const G2oEdge& edge) {
  return std::abs(file.ids[edge.to] - file.ids[edge.from]) == 1;
}

AnchorGraph GraphOf(const G2oGraph& file, bool robust) {
  AnchorGraph graph;
  graph.poses = file.poses;
  graph.fixed = file.fixed;
  for (const G2oEdge& edge : file.edges) {
    const bool certain = !robust || IsOdometry(file, edge);
    (certain ? graph.odometry : graph.loops)
        .push_back({edge.from, edge.to, edge.T_from_to, edge.information});
  }
  return graph;
}

int SolveGraph(const GraphArguments& arguments) {
  std::error_code ignored;
  if (std::filesystem::equivalent(arguments.graph, arguments.out, ignored))
    throw OptionError(arguments.out + ": is the graph that is read; give another --out");
  G2oGraph file = ReadG2o(arguments.graph);
  const AnchorGraph graph = GraphOf(file, arguments.robust);
  AnchorGraphOptions options;
  options.max_iterations = arguments.max_iterations;
  const Stopwatch watch;
  AnchorGraphResult result = SolveAnchorGraph(graph, options);
  if (!result.good) throw InputError(arguments.graph + ": could not be solved: " + result.reason);
  file.poses = std::move(result.poses);
  WriteG2o(arguments.out, file);
  fmt::print("{} poses, {} edges\n", file.poses.size(), file.edges.size());
  fmt::print("cost {:.6g} -> {:.6g} (sum of squared errors in sigmas), {} iterations, {:.2f} s\n",
             result.cost_before, result.cost, result.iterations, 1e-3 * watch.Milliseconds());
  if (arguments.robust) {
    const auto dropped = std::count(result.kept.begin(), result.kept.end(), false);
    fmt::print("{} of {} loops dropped: they contradict the rest\n", dropped, result.kept.size());
  }
  fmt::print("graph {}\n", arguments.out);
  return 0;
}

}  // namespace

void AddSolveGraphCommand(CLI::App* app, std::function<int()>* run) {
  auto arguments = std::make_shared<GraphArguments>();
  CLI::App* command = app->add_subcommand(
      "solve-graph", "Solve a pose graph in g2o form (VERTEX_SE3:QUAT, EDGE_SE3:QUAT)");
  command->add_option("graph", arguments->graph, "The graph, a .g2o file")->required();
  command->add_option("--out", arguments->out, "The solved graph, in the same form")->required();
  command->add_flag("--robust", arguments->robust,
                    "Let go of edges that contradict the rest; those between successive ids "
                    "(odometry) are always kept");
  command->add_option("--max-iterations", arguments->max_iterations, "Steps of a solve at most")
      ->check(CLI::Range(1, 100000));
  command->callback([arguments, run] { *run = [arguments] { return SolveGraph(*arguments); }; });
}

}  // namespace lamina
