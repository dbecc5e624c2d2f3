// Poses from relative poses, some of them wrong.
#include "backend/registration/pose_graph.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

namespace lamina {
namespace {

using testing::HasSubstr;

std::vector<SE3> Circle(std::size_t count) {
  std::vector<SE3> poses;
  for (std::size_t k = 0; k < count; ++k) {
    const double angle = 0.3 * static_cast<double>(k);
    poses.emplace_back(ExpSO3({0.0, 0.02 * static_cast<double>(k), angle}),
                       Eigen::Vector3d(4.0 * std::cos(angle), 4.0 * std::sin(angle), 0.0));
  }
  const SE3 first = poses[0].Inverse();
  for (SE3& T : poses) T = first * T;
  return poses;
}

// Each pose to the next three, with noise.
std::vector<PoseGraphEdge> Edges(const std::vector<SE3>& poses, double noise) {
  std::mt19937 random(1);
  std::normal_distribution<double> normal;
  std::vector<PoseGraphEdge> edges;
  for (std::size_t a = 0; a < poses.size(); ++a) {
    for (std::size_t b = a + 1; b < std::min(poses.size(), a + 4); ++b) {
      Vector6d delta;
      for (int i = 0; i < 6; ++i) delta(i) = noise * normal(random) * (i < 3 ? 0.1 : 1.0);
      edges.push_back({a, b, Retract(poses[a].Inverse() * poses[b], delta), 20.0});
    }
  }
  return edges;
}

double Worst(const std::vector<SE3>& a, const std::vector<SE3>& b) {
  double worst = 0.0;
  for (std::size_t k = 0; k < a.size(); ++k) worst = std::max(worst, (a[k].t - b[k].t).norm());
  return worst;
}

TEST(PoseGraph, ExactEdgesGiveExactPoses) {
  const std::vector<SE3> truth = Circle(20);
  const PoseGraphResult result = SolvePoseGraph(20, Edges(truth, 0.0), {});
  ASSERT_TRUE(result.good) << result.reason;
  EXPECT_LT(Worst(result.poses, truth), 1e-8);
  EXPECT_EQ(result.rejected, 0U);
}

TEST(PoseGraph, ManyEdgesAverageWhatAChainAddsUp) {
  const std::vector<SE3> truth = Circle(20);
  const std::vector<PoseGraphEdge> edges = Edges(truth, 0.02);
  const PoseGraphResult chained = SpanningTreePoses(20, edges);
  const PoseGraphResult result = SolvePoseGraph(20, edges, {});
  ASSERT_TRUE(result.good) << result.reason;
  EXPECT_LT(Worst(result.poses, truth), Worst(chained.poses, truth));
}

TEST(PoseGraph, WrongEdgesAreLetGoAndCounted) {
  const std::vector<SE3> truth = Circle(20);
  std::vector<PoseGraphEdge> edges = Edges(truth, 0.005);
  for (const std::size_t a : {2U, 7U, 11U}) {
    edges.push_back({a, a + 5, SE3(ExpSO3({1.0, 0.5, 0.0}), Eigen::Vector3d(3, 1, -2)), 15.0});
  }
  const PoseGraphResult result = SolvePoseGraph(20, edges, {});
  ASSERT_TRUE(result.good) << result.reason;
  EXPECT_LT(Worst(result.poses, truth), 0.03);
  EXPECT_EQ(result.rejected, 3U);
}

TEST(PoseGraph, APoseThatNothingLeadsToIsNamed) {
  const std::vector<SE3> truth = Circle(6);
  std::vector<PoseGraphEdge> edges = {{0, 1, SE3(), 1.0}, {1, 2, SE3(), 1.0}, {4, 5, SE3(), 1.0}};
  const PoseGraphResult result = SolvePoseGraph(6, edges, {});
  EXPECT_FALSE(result.good);
  EXPECT_THAT(result.reason, HasSubstr("joins scan 3 to the first"));
  EXPECT_TRUE(SolvePoseGraph(1, {}, {}).good);
}

TEST(PoseGraph, EdgesMayLeadBackwards) {
  const std::vector<SE3> truth = Circle(3);
  const std::vector<PoseGraphEdge> edges = {{1, 0, truth[1].Inverse() * truth[0], 1.0},
                                            {2, 1, truth[2].Inverse() * truth[1], 1.0}};
  EXPECT_LT(Worst(SolvePoseGraph(3, edges, {}).poses, truth), 1e-9);
}

}  // namespace
}  // namespace lamina
