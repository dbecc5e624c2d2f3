#include "tools/graph/command.h"

#include <gtest/gtest.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "io/map/g2o_file.h"
#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

int Solve(std::vector<std::string> arguments) {
  CLI::App app;
  std::function<int()> run;
  AddSolveGraphCommand(&app, &run);
  arguments.insert(arguments.begin(), "solve-graph");
  std::reverse(arguments.begin(), arguments.end());
  app.parse(arguments);
  return run();
}

// Rings of a sphere, as in the benchmark of that name: odometry along the rings, loops between
// them; the start is what odometry alone says.
G2oGraph SphereGraph(int rings, int ring, std::vector<SE3>* truth) {
  Draws draws(1);
  G2oGraph graph;
  const auto add = [&](std::size_t from, std::size_t to) {
    const SE3 error(ExpSO3(0.01 * draws.InCube(1.0)), 0.05 * draws.InCube(1.0));
    Vector6d information;
    information << Eigen::Vector3d::Constant(3e4), Eigen::Vector3d::Constant(1.2e3);
    graph.edges.push_back(
        {from, to, (*truth)[from].Inverse() * (*truth)[to] * error, information.asDiagonal()});
  };
  for (int i = 0; i < rings * ring; ++i) {
    const double latitude = M_PI * ((i + 0.5) / (rings * ring) - 0.5);
    const double longitude = 2.0 * M_PI * i / ring;
    const Eigen::Quaterniond q = Eigen::AngleAxisd(longitude, Eigen::Vector3d::UnitZ()) *
                                 Eigen::AngleAxisd(-latitude, Eigen::Vector3d::UnitY());
    truth->emplace_back(q, q * Eigen::Vector3d(50, 0, 0));
    const auto k = static_cast<std::size_t>(i);
    if (i > 0) add(k - 1, k);
    if (i >= ring) add(k - static_cast<std::size_t>(ring), k);
  }
  graph.poses.push_back(truth->front());
  for (std::size_t i = 1; i < truth->size(); ++i) {
    for (const G2oEdge& edge : graph.edges) {
      if (edge.to == i && edge.from == i - 1)
        graph.poses.push_back(graph.poses.back() * edge.T_from_to);
    }
  }
  for (std::size_t i = 0; i < truth->size(); ++i) graph.ids.push_back(static_cast<int>(i));
  return graph;
}

double Worst(const std::vector<SE3>& poses, const std::vector<SE3>& truth) {
  double worst = 0.0;
  for (std::size_t i = 0; i < poses.size(); ++i)
    worst = std::max(worst, (poses[i].t - truth[i].t).norm());
  return worst;
}

TEST(SolveGraphCommand, ASphereComesTogether) {
  const std::string in = testing::TempDir() + "lamina_sphere.g2o";
  const std::string out = testing::TempDir() + "lamina_sphere_solved.g2o";
  std::vector<SE3> truth;
  G2oGraph graph = SphereGraph(12, 20, &truth);
  WriteG2o(in, graph);
  EXPECT_EQ(Solve({in, "--out", out}), 0);
  const G2oGraph solved = ReadG2o(out);
  EXPECT_GT(Worst(graph.poses, truth), 2.0);
  EXPECT_LT(Worst(solved.poses, truth), 1.5);
  EXPECT_EQ(solved.edges.size(), graph.edges.size());

  // Wrong loops are let go of if that is asked for.
  Draws draws(8);
  for (int i = 0; i < 40; ++i) {
    const auto from = static_cast<std::size_t>(draws.Integer(0, 100));
    graph.edges.push_back({from, from + 60, draws.Pose(30.0), graph.edges[0].information});
  }
  WriteG2o(in, graph);
  EXPECT_EQ(Solve({in, "--robust", "--out", out}), 0);
  EXPECT_LT(Worst(ReadG2o(out).poses, truth), 1.5);
}

TEST(SolveGraphCommand, NeitherWrongFilesNorItsOwnInputAreOverwritten) {
  const std::string in = testing::TempDir() + "lamina_own.g2o";
  EXPECT_THROW(Solve({"/no/such.g2o", "--out", in}), InputError);
  G2oGraph graph;
  graph.ids = {0};
  graph.poses = {SE3()};
  WriteG2o(in, graph);
  EXPECT_THROW(Solve({in, "--out", in}), OptionError);
}

}  // namespace
}  // namespace lamina
