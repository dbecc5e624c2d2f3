#include "backend/pieces/ambiguous_place.h"

#include <gtest/gtest.h>

#include "tests/support/scenes/random_rooms.h"
#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

constexpr StampNs kScanNs = 100'000'000, kUnseenNs = 2'000'000'000;
// Walls across x, in blocks of their own along y; the other place is so far on.
constexpr double kNearWallM = 20.3, kApartM = 8.0;

class AmbiguousPlaceTest : public ::testing::Test {
 protected:
  AmbiguousPlaceTest()
      : map_(VoxelMapOptions()), window_(SlidingWindowOptions(), &map_), motion_(MotionOptions()) {}

  // What the sensor sees of walls so far ahead of it.
  std::vector<TimedCluster> Walls(std::initializer_list<double> ahead_m) {
    Points points;
    for (const double x : ahead_m) {
      for (int block = 0; block < 12; ++block) {
        for (int i = 0; i < 100; ++i)
          points.push_back({x + draws_.Normal(0.005), 6.0 * (block - 6) + draws_.Uniform(0.0, 1.0),
                            0.5 + draws_.Uniform(-0.4, 0.4)});
      }
    }
    return ScanFrom(SE3(), points, map_.options().LeafSize());
  }
  void Map(const std::vector<TimedCluster>& clusters, const SE3& T) {
    WindowFrame frame;
    frame.id = next_keyframe_++;
    frame.stamp_ns = stamp_ns_;
    frame.T_world_lidar = T;
    frame.measured = clusters;
    window_.Push(std::move(frame));
    map_.Refresh();
    motion_.Accept(stamp_ns_, T, next_keyframe_ > 1, Matrix6d::Identity() * 1e-6);
    stamp_ns_ += kScanNs;
  }
  // The next scan, matched where the sensor is, which may as well be kApartM further on.
  void Follow(const std::vector<TimedCluster>& clusters, bool elsewhere) {
    OdometryFrame frame;
    frame.status = OdometryFrame::Status::kTracked;
    frame.stamp_ns = stamp_ns_;
    if (elsewhere) frame.elsewhere(3) = kApartM;
    place_.Follow(frame, motion_, clusters, map_, window_, next_keyframe_);
    Map(clusters, frame.T_world_lidar);
  }

  Draws draws_{5};
  VoxelMap map_;
  SlidingWindow window_;
  MotionModel motion_;
  AmbiguousPlace place_;
  StampNs stamp_ns_ = kScanNs;
  std::int64_t next_keyframe_ = 0;
};

// Only before the gap were there walls in two places, and after it one more scan in the first makes
// that the better one by itself.
TEST_F(AmbiguousPlaceTest, IsNotToldByWhatWasMappedInIt) {
  for (int i = 0; i < 4; ++i) Map(Walls({kNearWallM, kNearWallM + kApartM}), SE3());
  stamp_ns_ += kUnseenNs;
  Follow(Walls({kNearWallM}), true);
  EXPECT_EQ(place_.first_keyframe(), 4);
  MatchResult match;
  place_.Widen(&match);
  EXPECT_EQ(match.degenerate, 1);
  EXPECT_NEAR(match.covariance(3, 3), kApartM * kApartM, 1e-6);
  for (int i = 0; i < 3; ++i) Follow(Walls({kNearWallM}), false);
  EXPECT_FALSE(place_.over());
  Follow(Walls({kNearWallM}), false);
  EXPECT_TRUE(place_.over());
}

TEST_F(AmbiguousPlaceTest, IsToldByWhatWasMappedBefore) {
  for (int i = 0; i < 4; ++i) Map(Walls({kNearWallM, kNearWallM + 3.0}), SE3());
  stamp_ns_ += kUnseenNs;
  Follow(Walls({kNearWallM, kNearWallM + 3.0}), true);
  MatchResult match;
  place_.Widen(&match);
  EXPECT_EQ(match.degenerate, 0);
  for (int i = 0; i < 6; ++i) Follow(Walls({kNearWallM}), false);
  EXPECT_FALSE(place_.over());
}

// Nothing more can be said for it than that the scans are here.
TEST_F(AmbiguousPlaceTest, IsOverWhereTheOtherOneIsBetter) {
  for (int i = 0; i < 4; ++i) Map(Walls({kNearWallM + kApartM, 3.0 * kApartM}), SE3());
  stamp_ns_ += kUnseenNs;
  Follow(Walls({kNearWallM, 2.0 * kApartM}), true);
  EXPECT_TRUE(place_.over());
}

}  // namespace
}  // namespace lamina
