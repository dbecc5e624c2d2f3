#include "io/map/g2o_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <string>

#include "core/base/error.h"
#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

using testing::HasSubstr;

constexpr char kUnitInformation[] = "1 0 0 0 0 0 1 0 0 0 0 1 0 0 0 4 0 0 4 0 4";

std::string File(const std::string& text) {
  const std::string path = testing::TempDir() + "lamina_graph.g2o";
  std::ofstream(path) << text;
  return path;
}

std::string Problem(const std::string& text) {
  try {
    ReadG2o(File(text));
  } catch (const InputError& error) {
    return error.what();
  }
  return "";
}

TEST(G2oFile, IsReadWithItsConventions) {
  const G2oGraph graph =
      ReadG2o(File("# a comment\nEDGE_SE3:QUAT 7 3 1 2 3 0 0 0.6 0.8 1 2 3 0 0 0 10 0 0 0 0 20 0 0 "
                   "0 4 0 0 4 0 4\n\nVERTEX_SE3:QUAT 7 0 0 1 0 0 0 1\r\n"
                   "VERTEX_SE3:QUAT 3 1 2 3 0 0 0.6 0.8\nFIX 7\n"));
  ASSERT_EQ(graph.poses.size(), 2U);
  EXPECT_EQ(graph.ids, (std::vector<std::int64_t>{3, 7}));
  EXPECT_EQ(graph.fixed, (std::vector<std::size_t>{1}));
  const G2oEdge& edge = graph.edges.at(0);
  EXPECT_EQ(edge.from, 1U);
  EXPECT_EQ(edge.to, 0U);
  EXPECT_DOUBLE_EQ(edge.T_from_to.q.z(), 0.6);
  EXPECT_EQ(edge.T_from_to.t, Eigen::Vector3d(1, 2, 3));
  // Rotation comes first, and its whole angle counts.
  EXPECT_EQ(edge.information(0, 0), 1.0);
  EXPECT_EQ(edge.information(3, 3), 1.0);
  EXPECT_EQ(edge.information(3, 4), 2.0);
  EXPECT_EQ(edge.information(5, 5), 20.0);
}

TEST(G2oFile, WhatIsWrittenIsRead) {
  Draws draws(3);
  G2oGraph graph;
  for (int i = 0; i < 4; ++i) {
    graph.ids.push_back(10 * i - 5);
    graph.poses.push_back(draws.Pose(1e4));
  }
  for (std::size_t i = 1; i < 4; ++i) {
    Matrix6d root;
    for (int k = 0; k < 36; ++k) root.data()[k] = draws.Normal(10.0);
    Matrix6d information = root * root.transpose();
    information = 0.5 * (information + information.transpose().eval());
    graph.edges.push_back({i - 1, i, draws.Pose(5.0), information});
  }
  graph.fixed = {2};
  const std::string path = testing::TempDir() + "lamina_written.g2o";
  WriteG2o(path, graph);
  const G2oGraph read = ReadG2o(path);
  EXPECT_EQ(read.ids, graph.ids);
  EXPECT_EQ(read.fixed, graph.fixed);
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_EQ(read.poses[i].t, graph.poses[i].t);
    EXPECT_LT(RotationAngle(read.poses[i], graph.poses[i]), 1e-12);
  }
  for (std::size_t i = 0; i < 3; ++i)
    EXPECT_EQ(read.edges[i].information, graph.edges[i].information);
}

TEST(G2oFile, WhatIsWrongIsNamed) {
  const std::string vertex = "VERTEX_SE3:QUAT 0 0 0 0 0 0 0 1\n";
  const std::string edge = "EDGE_SE3:QUAT 0 1 0 0 0 0 0 0 1 ";
  EXPECT_THAT(Problem(""), HasSubstr("no vertex"));
  EXPECT_THAT(Problem("VERTEX_SE3:QUAT 0 0 0\n"),
              HasSubstr(":1: VERTEX_SE3:QUAT must be followed by 8 numbers, found 3"));
  EXPECT_THAT(Problem("VERTEX_SE3:QUAT 0 0 0 nan 0 0 0 1\n"), HasSubstr("'nan' is not a finite"));
  EXPECT_THAT(Problem("VERTEX_SE3:QUAT 0 0 0 0 0 0 0 0\n"), HasSubstr("norm 0"));
  EXPECT_THAT(Problem("VERTEX_SE3:QUAT 0.5 0 0 0 0 0 0 1\n"), HasSubstr("not an id"));
  EXPECT_THAT(Problem(vertex + vertex), HasSubstr(":2: vertex 0 is given twice"));
  EXPECT_THAT(Problem(vertex + edge + kUnitInformation + "\n"),
              HasSubstr(":2: there is no vertex 1"));
  EXPECT_THAT(Problem(vertex + edge + "-" + kUnitInformation + "\n"),
              HasSubstr("positive semi-definite"));
  EXPECT_THAT(Problem("EDGE_SE3:QUAT 0 0 0 0 0 0 0 0 1 " + std::string(kUnitInformation)),
              HasSubstr("to itself"));
  EXPECT_THAT(Problem("VERTEX_SE2 0 0 0 0\n"), HasSubstr("no 2D graphs"));
  EXPECT_THAT(Problem(vertex + "FIX 3\n"), HasSubstr(":2: there is no vertex 3"));
  EXPECT_THAT(Problem(std::string("\0\x01\xff\n", 4)), HasSubstr(":1:"));
  EXPECT_THROW(ReadG2o("/no/such/file.g2o"), InputError);
}

}  // namespace
}  // namespace lamina
