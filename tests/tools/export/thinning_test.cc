#include "tools/export/thinning.h"

#include <gtest/gtest.h>

#include <random>
#include <set>

namespace lamina {
namespace {

using Result = VoxelSet::Result;

TEST(VoxelSet, HoldsWhatWasInserted) {
  std::mt19937_64 random(1);
  VoxelSet set(std::size_t{1} << 24);
  std::set<VoxelKey> expected;
  for (int i = 0; i < 100000; ++i) {
    const VoxelKey key = random() % 50000;
    EXPECT_EQ(set.Insert(key), expected.insert(key).second ? Result::kInserted : Result::kPresent);
  }
  EXPECT_EQ(set.size(), expected.size());
  set.Filter([](VoxelKey key) { return key % 3 == 0; });
  std::set<VoxelKey> left;
  set.ForEach([&](VoxelKey key) { left.insert(key); });
  for (auto it = expected.begin(); it != expected.end();) {
    it = *it % 3 == 0 ? std::next(it) : expected.erase(it);
  }
  EXPECT_EQ(left, expected);
}

TEST(VoxelSet, StopsAtItsBudget) {
  constexpr std::size_t kBudget = 1 << 16;
  VoxelSet set(kBudget);
  VoxelKey key = 0;
  while (set.Insert(key) == Result::kInserted) ++key;
  EXPECT_LE(2 * set.bytes(), kBudget);
  // Not wasteful either: three quarters of the slots that half of the budget has room for.
  EXPECT_EQ(set.size(), kBudget / 2 / sizeof(VoxelKey) * 3 / 4);
  EXPECT_EQ(set.Insert(key), Result::kFull);
  EXPECT_EQ(set.Insert(0), Result::kPresent);
  set.Filter([](VoxelKey k) { return k % 2 == 0; });
  EXPECT_EQ(set.Insert(key), Result::kInserted);
}

TEST(VoxelBox, MeetsTheBallsThatReachIntoIt) {
  VoxelBox box;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    box.low[axis] = kVoxelKeyOffset;
    box.high[axis] = kVoxelKeyOffset + 10;  // 0 .. 5 m
  }
  EXPECT_TRUE(box.MeetsBall({2.0, 2.0, 2.0}, 0.1, 0.5));
  EXPECT_TRUE(box.MeetsBall({-3.0, 2.0, 2.0}, 3.01, 0.5));
  EXPECT_FALSE(box.MeetsBall({-3.0, 2.0, 2.0}, 2.99, 0.5));
  EXPECT_TRUE(box.MeetsBall({8.0, 9.0, 2.0}, 5.01, 0.5));
  EXPECT_FALSE(box.MeetsBall({8.0, 9.0, 2.0}, 4.99, 0.5));
  EXPECT_TRUE(VoxelBox().MeetsBall({1e5, -1e5, 0.0}, 0.0, 0.5));
  EXPECT_TRUE(box.Contains(VoxelKeyOf({0.1, 4.9, 0.1}, 2.0)));
  EXPECT_FALSE(box.Contains(VoxelKeyOf({0.1, 5.1, 0.1}, 2.0)));
  EXPECT_FALSE(box.Contains(VoxelKeyOf({-0.1, 4.9, 0.1}, 2.0)));
}

// Runs all passes over the stream; the places kept, each checked to be kept once.
std::set<std::size_t> KeptPlaces(const std::vector<VoxelKey>& stream, std::size_t budget,
                                 int* passes) {
  PassThinner thinner(budget);
  std::set<std::size_t> kept;
  while (thinner.BeginPass()) {
    for (std::size_t i = 0; i < stream.size(); ++i) {
      if (!thinner.Keep(stream[i], {i / 100, i % 100})) continue;
      EXPECT_TRUE(kept.insert(i).second) << "place " << i << " was kept twice";
    }
  }
  EXPECT_EQ(thinner.kept(), kept.size());
  *passes = thinner.passes();
  return kept;
}

std::set<std::size_t> FirstPlaces(const std::vector<VoxelKey>& stream) {
  std::set<VoxelKey> seen;
  std::set<std::size_t> places;
  for (std::size_t i = 0; i < stream.size(); ++i) {
    if (seen.insert(stream[i]).second) places.insert(i);
  }
  return places;
}

TEST(PassThinner, ManyPassesKeepWhatOneWouldKeep) {
  std::mt19937 random(2);
  for (const double spread : {3.0, 30.0, 300.0}) {
    std::normal_distribution<double> normal(0.0, spread);
    std::vector<VoxelKey> stream;
    for (int i = 0; i < 20000; ++i) {
      stream.push_back(VoxelKeyOf({normal(random), 0.3 * normal(random), 0.1 * normal(random)}, 1));
    }
    const std::set<std::size_t> expected = FirstPlaces(stream);
    for (const std::size_t budget : {1U << 12, 1U << 16, 1U << 24}) {
      int passes = 0;
      EXPECT_EQ(KeptPlaces(stream, budget, &passes), expected) << "budget " << budget;
      EXPECT_EQ(passes > 1, expected.size() * 64 > 3 * budget) << passes << " passes";
    }
  }
}

// Voxels in one layer but for one stray: a cut at the median would leave one side empty.
TEST(PassThinner, CutsLopsidedCrowds) {
  for (const bool stray_below : {true, false}) {
    std::vector<VoxelKey> stream{PackVoxelKey(stray_below ? -5000 : 5000, 0, 0)};
    for (int i = 0; i < 40; ++i) {
      for (int k = 0; k < 40; ++k) stream.push_back(PackVoxelKey(0, i, k));
    }
    int passes = 0;
    EXPECT_EQ(KeptPlaces(stream, 0, &passes).size(), stream.size());
    EXPECT_GT(passes, 30);
  }
}

}  // namespace
}  // namespace lamina
