#include "backend/pieces/older_planes.h"

#include <gtest/gtest.h>

#include "tests/support/scenes/random_rooms.h"
#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

// Walls across x, in voxels of their own along y.
constexpr double kWallM = 0.3, kOldY = 0.5, kNewY = 20.5;

class OlderPlanesTest : public ::testing::Test {
 protected:
  OlderPlanesTest() : map_(VoxelMapOptions()), window_(SlidingWindowOptions(), &map_) {}

  // A scan that sees the wall at each of these places `off_m` too far.
  void Scan(double off_m, std::initializer_list<double> places) {
    WindowFrame frame;
    frame.id = next_;
    frame.stamp_ns = 100'000'000 * next_++;
    frame.T_world_lidar = SE3(Eigen::Quaterniond::Identity(), {off_m, 0.0, 0.0});
    const double leaf_m = map_.options().LeafSize();
    for (const double y : places) {
      Points points;
      for (int i = 0; i < 200; ++i)
        points.push_back({kWallM + draws_.Normal(0.005), y + draws_.Uniform(-0.4, 0.4),
                          0.5 + draws_.Uniform(-0.4, 0.4)});
      for (const TimedCluster& c : ScanFrom(SE3(), points, leaf_m)) frame.measured.push_back(c);
    }
    window_.Push(std::move(frame));
    map_.Refresh();
  }
  VoxelMap::NodeId At(double y) const { return map_.FindSurface({kWallM, y, 0.5}); }

  Draws draws_{3};
  VoxelMap map_;
  SlidingWindow window_;
  std::int64_t next_ = 0;
};

TEST_F(OlderPlanesTest, AreThoseWithoutWhatTheWindowHasAddedSince) {
  for (int i = 0; i < 3; ++i) Scan(0.0, {kOldY});
  for (int i = 0; i < 6; ++i) Scan(0.03, {kOldY, kNewY});
  ASSERT_EQ(map_.kind(At(kOldY)), Surface::Kind::kPlane);
  ASSERT_EQ(map_.kind(At(kNewY)), Surface::Kind::kPlane);
  EXPECT_NEAR(map_.plane(At(kOldY)).mean.x(), kWallM + 0.02, 0.003);
  OlderPlanes older(map_, window_, 3);
  const WeightedPlane plane = older.Of(At(kOldY));
  ASSERT_NE(plane.plane, nullptr);
  EXPECT_NEAR(plane.plane->mean.x(), kWallM, 0.003);
  EXPECT_EQ(plane.plane->frames, 3);
  EXPECT_EQ(plane.weight, 1.0);
  EXPECT_EQ(older.Of(At(kNewY)).plane, nullptr);
}

TEST_F(OlderPlanesTest, CountLessWhereNewerPointsHaveLeftTheWindow) {
  for (int i = 0; i < 6; ++i) Scan(0.0, {kOldY});
  for (int i = 0; i < 6; ++i) window_.PopOldest();
  map_.Refresh();
  // Of six frames of up to four points the last three are of the fourth and later.
  OlderPlanes half(map_, window_, 3), none(map_, window_, 0);
  EXPECT_LT(half.Of(At(kOldY)).weight, 0.25 + 1e-6);
  EXPECT_GT(half.Of(At(kOldY)).weight, 0.1);
  EXPECT_EQ(none.Of(At(kOldY)).plane, nullptr);
  OlderPlanes all(map_, window_, 6);
  EXPECT_EQ(all.Of(At(kOldY)).weight, 1.0);
}

}  // namespace
}  // namespace lamina
