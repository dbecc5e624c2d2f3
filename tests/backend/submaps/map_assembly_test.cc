#include "backend/submaps/map_assembly.h"

#include <gtest/gtest.h>

#include <vector>

#include "tests/support/scenes/submap_town.h"

namespace lamina {
namespace {

constexpr double kAssemblyLeafM = 0.8;

std::vector<Submap> SomeSubmaps() {
  const Town town(3, 60.0);
  Draws draws(4);
  SubmapOptions options;
  options.length_m = 15.0;
  SubmapBuilder builder(options, kAssemblyLeafM);
  std::vector<Submap> submaps;
  const std::vector<SE3> drive = Drive({{0, -40}, {0, 30}});
  for (std::size_t i = 0; i < drive.size(); ++i) {
    const auto id = static_cast<std::int64_t>(i);
    if (auto submap = builder.Add(KeyframeOf(town, id, drive[i], drive[i], kAssemblyLeafM, &draws)))
      submaps.push_back(std::move(*submap));
  }
  submaps.push_back(*builder.Finish());
  return submaps;
}

TEST(AssembleFixed, ALeafHasTheCappedSumOfItsSubmaps) {
  const std::vector<Submap> submaps = SomeSubmaps();
  ASSERT_GE(submaps.size(), 3U);
  std::vector<PlacedSubmap> placed;
  for (const Submap& submap : submaps) placed.push_back({&submap, submap.T_world_submap});
  VoxelMapOptions options;
  options.max_fixed_weight = 1e9;
  const auto parts = AssembleFixed(placed, options, {0, 0, 0});
  double given = 0.0, taken = 0.0;
  for (const Submap& submap : submaps) {
    for (const SubmapLeaf& leaf : submap.leaves) given += static_cast<double>(leaf.cluster.count);
  }
  std::vector<VoxelKey> leaves;
  for (const VoxelMap::FixedPart& part : parts) {
    taken += part.cluster.count;
    leaves.push_back(VoxelKeyOf(part.cluster.mean, 1.0 / kAssemblyLeafM));
  }
  EXPECT_NEAR(taken, given, 1e-6 * given);
  std::sort(leaves.begin(), leaves.end());
  EXPECT_EQ(std::adjacent_find(leaves.begin(), leaves.end()), leaves.end());
  options.max_fixed_weight = 3.0;
  for (const VoxelMap::FixedPart& part : AssembleFixed(placed, options, {0, 0, 0}))
    EXPECT_LE(part.cluster.count, 3.0 + 1e-9);
}

TEST(AssembleFixed, TheNearestComeLast) {
  const std::vector<Submap> submaps = SomeSubmaps();
  const Eigen::Vector3d sensor(0, -40, 0);
  const auto parts =
      AssembleFixed({{&submaps[0], submaps[0].T_world_submap}}, VoxelMapOptions(), sensor);
  ASSERT_GT(parts.size(), 100U);
  EXPECT_LT((parts.back().cluster.mean - sensor).norm(), 10.0);
  EXPECT_GT((parts.front().cluster.mean - sensor).norm(), 30.0);
}

TEST(SubmapBuilder, TheCurrentOneIsWhatFinishWouldGive) {
  const Town town(3, 60.0);
  Draws draws(4);
  SubmapBuilder builder({}, kAssemblyLeafM);
  EXPECT_TRUE(builder.Current().keyframes.empty());
  const std::vector<SE3> drive = Drive({{0, 0}, {0, 20}});
  for (std::size_t i = 0; i < drive.size(); ++i)
    builder.Add(
        KeyframeOf(town, static_cast<std::int64_t>(i), drive[i], drive[i], kAssemblyLeafM, &draws));
  const Submap current = builder.Current();
  const Submap finished = *builder.Finish();
  ASSERT_EQ(current.leaves.size(), finished.leaves.size());
  ASSERT_EQ(current.keyframes.size(), finished.keyframes.size());
  EXPECT_EQ(current.leaves[7].cluster.count, finished.leaves[7].cluster.count);
  EXPECT_EQ(builder.Current().id, finished.id + 1);
}

}  // namespace
}  // namespace lamina
