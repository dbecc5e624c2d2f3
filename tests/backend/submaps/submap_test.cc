#include "backend/submaps/submap.h"

#include <gtest/gtest.h>

#include <vector>

#include "tests/support/memory_byte_store.h"
#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

constexpr double kSubmapLeafM = 0.5;

FinalKeyframe Keyframe(std::int64_t id, const SE3& T, const Points& points) {
  FinalKeyframe keyframe{id, 1000 * id, T, {}};
  for (const Eigen::Vector3d& p : points) keyframe.clusters.push_back(ClusterOf({p}));
  return keyframe;
}

// Keyframes 4 m apart, `count` of them, in a world that lies at `origin`.
std::vector<Submap> Build(const SubmapOptions& options, int count, const Eigen::Vector3d& origin) {
  Draws draws(3);
  SubmapBuilder builder(options, kSubmapLeafM);
  std::vector<Submap> submaps;
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector3d at = origin + Eigen::Vector3d(4.0 * i, 0, 0);
    const Points points = draws.Cloud(500, at, 6.0);
    if (auto submap = builder.Add(Keyframe(i, SE3(ExpSO3({0, 0, 0.1 * i}), at), points)))
      submaps.push_back(*submap);
  }
  if (auto submap = builder.Finish()) submaps.push_back(*submap);
  return submaps;
}

TEST(SubmapBuilder, EachKeyframeIsInExactlyOneSubmap) {
  SubmapOptions options;
  options.length_m = 20.0;
  const std::vector<Submap> submaps = Build(options, 13, {0, 0, 0});
  ASSERT_EQ(submaps.size(), 3U);
  std::int64_t next = 0;
  double points = 0.0;
  for (std::size_t i = 0; i < submaps.size(); ++i) {
    EXPECT_EQ(submaps[i].id, static_cast<std::int64_t>(i));
    EXPECT_EQ(submaps[i].keyframes.size(), i < 2 ? 5U : 3U);
    for (const SubmapKeyframe& keyframe : submaps[i].keyframes) EXPECT_EQ(keyframe.id, next++);
    for (const SubmapLeaf& leaf : submaps[i].leaves)
      points += static_cast<double>(leaf.cluster.count);
  }
  EXPECT_EQ(next, 13);
  EXPECT_DOUBLE_EQ(points, 13.0 * 500.0);
  EXPECT_NEAR(submaps[0].way_m, 20.0, 1e-9);
}

TEST(Submap, LeavesThatAreStoredAreReadWhereTheyAreLookedAt) {
  Submap submap = Build({}, 3, {0, 0, 0}).at(0);
  const std::size_t count = submap.leaves.size();
  StateArchive before, after, beside;
  submap.Archive(before);
  MemoryByteStore store;
  submap.StoreIn(&store);
  submap.Release();
  EXPECT_TRUE(submap.leaves.empty());
  EXPECT_EQ(submap.LeafCount(), count);
  EXPECT_EQ(submap.Leaves().size(), count);
  submap.Archive(after);
  EXPECT_EQ(after.written(), before.written());
  submap.ArchiveBeside(&store, beside);
  EXPECT_LT(beside.written().size() + count * sizeof(SubmapLeaf), before.written().size() + 100);
  StateArchive reading(beside.written());
  Submap again;
  again.ArchiveBeside(&store, reading);
  EXPECT_EQ(again.Leaves().size(), count);
  StateArchive without(beside.written());
  EXPECT_THROW(Submap().ArchiveBeside(nullptr, without), InputError);
  store.damaged = true;
  EXPECT_EQ(submap.Leaves().size(), 0U);
}

TEST(SubmapBuilder, ManyKeyframesOnTheSpotEndASubmap) {
  SubmapOptions options;
  options.max_keyframes = 4;
  SubmapBuilder builder(options, kSubmapLeafM);
  int complete = 0;
  for (int i = 0; i < 10; ++i) complete += builder.Add(Keyframe(i, SE3(), {{1, 1, 1}})) ? 1 : 0;
  EXPECT_EQ(complete, 2);
  EXPECT_TRUE(builder.Finish());
  EXPECT_FALSE(builder.Finish());
}

TEST(SubmapBuilder, LeavesHoldTheClustersOfTheirPoints) {
  Draws draws(5);
  const SE3 T = draws.Pose(30.0);
  SubmapBuilder builder({}, kSubmapLeafM);
  // All within one leaf of the submap's frame.
  const Points points = draws.Cloud(50, {10.25, -4.75, 0.25}, 0.2);
  FinalKeyframe keyframe{0, 0, T, {}};
  for (const Eigen::Vector3d& p : points) keyframe.clusters.push_back(ClusterOf({T * p}));
  builder.Add(keyframe);
  const Submap submap = *builder.Finish();
  ASSERT_EQ(submap.leaves.size(), 1U);
  const PointCluster expected = ClusterOf(points), got = submap.Cluster(submap.leaves[0]);
  EXPECT_DOUBLE_EQ(got.count, expected.count);
  EXPECT_LT(MeanGap(got, expected), 1e-6);
  EXPECT_LT(ScatterGap(got, expected), 1e-5);
  EXPECT_EQ(submap.leaves[0].keyframes, 1);
}

TEST(SubmapBuilder, ItIsAsExactFarFromTheOrigin) {
  const std::vector<Submap> near = Build({}, 7, {0, 0, 0});
  const std::vector<Submap> far = Build({}, 7, {1e5, -2e5, 300});
  ASSERT_EQ(near.size(), far.size());
  ASSERT_EQ(near[0].leaves.size(), far[0].leaves.size());
  for (std::size_t i = 0; i < near[0].leaves.size(); i += 17) {
    const PointCluster a = near[0].Cluster(near[0].leaves[i]);
    const PointCluster b = far[0].Cluster(far[0].leaves[i]);
    EXPECT_LT(MeanGap(a, b), 1e-5);
    EXPECT_LT(ScatterGap(a, b), 1e-4);
  }
}

TEST(SubmapBuilder, PointsOutOfReachAndNotANumberAreLeftOut) {
  SubmapBuilder builder({}, kSubmapLeafM);
  builder.Add(Keyframe(0, SE3(), {{1, 2, 3}, {1e6, 0, 0}, {NAN, 0, 0}}));
  EXPECT_EQ(builder.Finish()->leaves.size(), 1U);
}

}  // namespace
}  // namespace lamina
