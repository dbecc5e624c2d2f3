#include "core/map/voxel_key.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <unordered_map>

#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

// Keys of a block of voxels about the origin.
std::vector<VoxelKey> BlockKeys(int half_x, int half_y, int half_z) {
  std::vector<VoxelKey> keys;
  for (int x = -half_x; x < half_x; ++x) {
    for (int y = -half_y; y < half_y; ++y) {
      for (int z = -half_z; z < half_z; ++z) keys.push_back(PackVoxelKey(x, y, z));
    }
  }
  return keys;
}

TEST(VoxelKey, CentresOfPackedIndicesRoundTrip) {
  Draws draws(1);
  constexpr int kMost = (1 << 20) - 1;
  for (int i = 0; i < 10000; ++i) {
    const int x = draws.Integer(-kMost - 1, kMost);
    const int y = i % 3 == 0 ? -1 : draws.Integer(-kMost - 1, kMost);
    const int z = i % 5 == 0 ? kMost : draws.Integer(-3, 3);
    const Eigen::Vector3d centre = VoxelCentre(PackVoxelKey(x, y, z), 0.5);
    EXPECT_EQ(centre, 0.5 * (Eigen::Vector3d(x, y, z) + Eigen::Vector3d::Constant(0.5)));
  }
}

TEST(VoxelKey, PointsFallIntoTheVoxelAroundThem) {
  Draws draws(2);
  for (int i = 0; i < 10000; ++i) {
    const double size = draws.Uniform(0.1, 3.0);
    const Eigen::Vector3d p = draws.InCube(i % 2 == 0 ? 2.0 : 1e5);
    const Eigen::Vector3d centre = VoxelCentre(VoxelKeyOf(p, 1.0 / size), size);
    EXPECT_LE((p - centre).cwiseAbs().maxCoeff(), 0.5 * size * (1.0 + 1e-9));
  }
}

TEST(VoxelKey, RangeEndsBeforeIndicesOverflow) {
  EXPECT_TRUE(IsVoxelKeyInRange({1e6, -1e6, 0.0}, 1.0));
  EXPECT_FALSE(IsVoxelKeyInRange({0.0, 1.1e6, 0.0}, 1.0));
  EXPECT_FALSE(IsVoxelKeyInRange({0.0, 0.0, -1e300}, 1.0));
}

TEST(VoxelIndex, AgreesWithStdMapOverRandomOperations) {
  Draws draws(3);
  VoxelIndex index;
  std::unordered_map<VoxelKey, std::int32_t> expected;
  for (int i = 0; i < 100000; ++i) {
    // Few distinct keys, so that erasing and finding meet what is there.
    const VoxelKey key =
        PackVoxelKey(draws.Integer(-10, 10), draws.Integer(-10, 10), draws.Integer(-5, 5));
    const int what = draws.Integer(0, 9);
    if (what < 4) {
      EXPECT_EQ(index.FindOrInsert(key, i), expected.emplace(key, i).first->second);
    } else if (what < 7) {
      index.Erase(key);
      expected.erase(key);
    } else {
      const auto found = expected.find(key);
      EXPECT_EQ(index.Find(key), found == expected.end() ? VoxelIndex::kNone : found->second);
    }
    ASSERT_EQ(index.size(), expected.size());
  }
  EXPECT_GT(expected.size(), 500U);
  for (const auto& [key, value] : expected) EXPECT_EQ(index.Find(key), value);
}

TEST(VoxelIndex, IsASetAndGathersInTheOrderOfTheFirst) {
  VoxelIndex set, index;
  std::vector<int> counts;
  for (const VoxelKey key : {7U, 3U, 7U, 9U, 3U, 7U}) {
    const bool known = set.Find(key) != VoxelIndex::kNone;
    EXPECT_EQ(set.Insert(key), !known);
    ++index.Gather(key, &counts);
  }
  EXPECT_EQ(set.size(), 3U);
  EXPECT_EQ(counts, (std::vector<int>{3, 2, 1}));
  EXPECT_EQ(index.Find(3), 1);
}

TEST(VoxelIndex, HoldsMillionsInLittleMemory) {
  const std::vector<VoxelKey> keys = BlockKeys(180, 180, 9);
  ASSERT_GT(keys.size(), 2000000U);
  VoxelIndex index;
  std::size_t most_bytes_each = 0;
  for (std::size_t i = 0; i < keys.size(); ++i) {
    index.FindOrInsert(keys[i], static_cast<std::int32_t>(i));
    if (i >= 1000) most_bytes_each = std::max(most_bytes_each, index.bytes() / index.size());
  }
  EXPECT_EQ(index.size(), keys.size());
  // 16 bytes a slot, between a quarter and a half full.
  EXPECT_LE(most_bytes_each, 64U);
  std::size_t wrong = 0;
  for (std::size_t i = 0; i < keys.size(); ++i) {
    if (index.Find(keys[i]) != static_cast<std::int32_t>(i)) ++wrong;
  }
  EXPECT_EQ(wrong, 0U);
  EXPECT_EQ(index.Find(PackVoxelKey(1000, 1000, 1000)), VoxelIndex::kNone);
}

TEST(VoxelIndex, NeighboursScatterOverTheTable) {
  // Linear probing by hand: how far each of two million neighbours comes to lie from its home.
  const std::vector<VoxelKey> keys = BlockKeys(180, 180, 8);
  ASSERT_GT(keys.size(), 2000000U);
  constexpr std::size_t kSlots = std::size_t{1} << 22;
  std::vector<bool> taken(kSlots, false);
  std::size_t longest = 0;
  std::size_t sum = 0;
  for (const VoxelKey key : keys) {
    std::size_t probes = 1;
    std::size_t i = HashVoxelKey(key) & (kSlots - 1);
    for (; taken[i]; i = (i + 1) & (kSlots - 1)) ++probes;
    taken[i] = true;
    longest = std::max(longest, probes);
    sum += probes;
  }
  // Knuth: (1 + 1 / (1 - load)) / 2 = 1.5 at half load with a perfect hash.
  EXPECT_LT(static_cast<double>(sum) / static_cast<double>(keys.size()), 1.6);
  EXPECT_LT(longest, 120U);
}

}  // namespace
}  // namespace lamina
