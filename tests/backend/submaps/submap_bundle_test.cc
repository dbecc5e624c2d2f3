#include "backend/submaps/submap_bundle.h"

#include <gtest/gtest.h>

#include <cmath>
#include <utility>
#include <vector>

#include "tests/support/scenes/submap_town.h"

namespace lamina {
namespace {

constexpr double kBundleLeafM = 0.8;

// Submaps of drives through one town, each with its true anchor.
struct MappedTown {
  std::vector<Submap> submaps;
  std::vector<SE3> truth;
  AnchorGraph graph;

  std::vector<const Submap*> pointers() const {
    std::vector<const Submap*> pointers;
    for (const Submap& submap : submaps) pointers.push_back(&submap);
    return pointers;
  }
  double ErrorM(const std::vector<SE3>& anchors) const {
    double square = 0.0;
    for (std::size_t i = 0; i < truth.size(); ++i) {
      const SE3 T = anchors[0].Inverse() * anchors[i], T_true = truth[0].Inverse() * truth[i];
      square += (T.t - T_true.t).squaredNorm();
    }
    return std::sqrt(square / static_cast<double>(truth.size()));
  }
};

void AddDrive(const Town& town, const std::vector<SE3>& drive, Draws* draws, MappedTown* mapped) {
  SubmapBuilder builder({}, kBundleLeafM);
  std::vector<Submap> submaps;
  for (std::size_t i = 0; i < drive.size(); ++i) {
    if (auto submap = builder.Add(KeyframeOf(town, static_cast<std::int64_t>(i), drive[i], drive[i],
                                             kBundleLeafM, draws)))
      submaps.push_back(std::move(*submap));
  }
  submaps.push_back(*builder.Finish());
  for (Submap& submap : submaps) {
    mapped->truth.push_back(submap.T_world_submap);
    mapped->submaps.push_back(std::move(submap));
  }
}

// Edges between successive submaps, and anchors that go along them: both off by so much.
void Disturb(double turn_rad, double step_m, Draws* draws, MappedTown* mapped) {
  Vector6d information;
  information << Eigen::Vector3d::Constant(1.0 / (turn_rad * turn_rad)),
      Eigen::Vector3d::Constant(1.0 / (step_m * step_m));
  mapped->graph.poses = {mapped->truth[0]};
  for (std::size_t i = 1; i < mapped->truth.size(); ++i) {
    const SE3 T = mapped->truth[i - 1].Inverse() * mapped->truth[i] *
                  SE3(ExpSO3(turn_rad * draws->InCube(1.0)), step_m * draws->InCube(1.0));
    mapped->graph.odometry.push_back({i - 1, i, T, information.asDiagonal()});
    mapped->graph.poses.push_back(mapped->graph.poses.back() * T);
  }
}

MappedTown TwoDrives() {
  const Town town(1);
  Draws draws(5);
  MappedTown mapped;
  AddDrive(town, Drive({{-60, -60}, {60, -60}}), &draws, &mapped);
  AddDrive(town, Drive({{60, -60}, {-60, -60}}), &draws, &mapped);
  Disturb(0.001, 0.03, &draws, &mapped);
  return mapped;
}

TEST(SubmapBundle, SubmapsThatOverlapComeTogether) {
  const MappedTown mapped = TwoDrives();
  const SubmapBundleResult result =
      AdjustSubmaps(mapped.pointers(), mapped.graph, {}, VoxelMapOptions());
  EXPECT_EQ(result.refusal, "");
  EXPECT_GT(result.planes, 100U);
  EXPECT_GT(mapped.ErrorM(mapped.graph.poses), 0.03);
  EXPECT_LT(mapped.ErrorM(result.anchors), 0.01);
  EXPECT_LT((result.anchors[0].t - mapped.graph.poses[0].t).norm(), 1e-9);
}

TEST(SubmapBundle, TheSameBitsAtAnyNumberOfThreads) {
  const MappedTown mapped = TwoDrives();
  const auto adjust = [&] {
    return AdjustSubmaps(mapped.pointers(), mapped.graph, {}, VoxelMapOptions());
  };
  const SubmapBundleResult two = adjust();
  const ThreadLimit limit(1);
  const SubmapBundleResult one = adjust();
  for (std::size_t i = 0; i < one.anchors.size(); ++i) {
    EXPECT_EQ(one.anchors[i].t, two.anchors[i].t);
    EXPECT_EQ(one.anchors[i].q.coeffs(), two.anchors[i].q.coeffs());
  }
}

TEST(SubmapBundle, AlongACorridorTheGraphDecides) {
  // Nothing but ground and two endless walls: planes say nothing of the way along them.
  std::vector<Facet> facets;
  for (double x = -150; x < 150; x += 6.0) {
    for (double y = -6.0; y < 6.0; y += 6.0)
      facets.push_back({{x + 3, y + 3, 0}, {3, 0, 0}, {0, 3, 0}});
    for (const double y : {-6.0, 6.0}) facets.push_back({{x + 3, y, 3}, {3, 0, 0}, {0, 0, 3}});
  }
  const Town corridor(std::move(facets));
  Draws draws(5);
  MappedTown mapped;
  AddDrive(corridor, Drive({{-60, 0}, {60, 0}}), &draws, &mapped);
  Disturb(0.0005, 0.02, &draws, &mapped);
  const SubmapBundleResult result =
      AdjustSubmaps(mapped.pointers(), mapped.graph, {}, VoxelMapOptions());
  for (std::size_t i = 1; i < mapped.truth.size(); ++i) {
    const double before = (mapped.graph.poses[i - 1].Inverse() * mapped.graph.poses[i]).t.x();
    const double after = (result.anchors[i - 1].Inverse() * result.anchors[i]).t.x();
    EXPECT_NEAR(after, before, 0.01) << i;
  }
}

TEST(SubmapBundle, PartsThatNothingJoinsAndSingleSubmapsStayWhereTheyAre) {
  MappedTown mapped = TwoDrives();
  mapped.graph.odometry.clear();
  const SubmapBundleResult result =
      AdjustSubmaps(mapped.pointers(), mapped.graph, {}, VoxelMapOptions());
  EXPECT_EQ(result.rounds, 0);
  for (std::size_t i = 0; i < mapped.truth.size(); ++i)
    EXPECT_EQ(result.anchors[i].t, mapped.graph.poses[i].t);
  SubmapBundleOptions none;
  none.rounds = 0;
  EXPECT_EQ(AdjustSubmaps(mapped.pointers(), TwoDrives().graph, none, VoxelMapOptions()).rounds, 0);
}

}  // namespace
}  // namespace lamina
