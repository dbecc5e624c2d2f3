#include "backend/pieces/localiser.h"

#include <gtest/gtest.h>

#include "backend/pieces/mapper.h"
#include "tests/support/scenes/random_rooms.h"

namespace lamina {
namespace {

// A room that was mapped, and scans of it.
class MappedRoom {
 public:
  MappedRoom() : map_(Options().map) {
    Mapper mapper(Options(), &map_, 0);
    for (int i = 0; i < 10; ++i) mapper.Process(Next(At(0.02 * i)));
    mapper.Close();
  }

  static MapperOptions Options() {
    MapperOptions options;
    options.backend.restart_after_lost_frames = 3;
    return options;
  }
  static SE3 At(double x_m) { return {Eigen::Quaterniond::Identity(), {x_m, 0.0, 0.0}}; }
  MapperScan Next(const SE3& T_world_lidar) {
    clusters_ = ScanFrom(T_world_lidar, World::Room().Sample(2000, 0.005, &draws_),
                         Options().map.LeafSize());
    ++count_;
    return {count_, count_ * StampNs{100000000}, false, &clusters_};
  }
  // The scans until one is to begin a piece of its own; 0: none of 20 is.
  int ScansUntilRestart(Localiser* localiser) {
    for (int i = 1; i <= 20; ++i) {
      const RegisteredScan scan = localiser->Process(Next(At(0.0)));
      EXPECT_EQ(scan.odometry.status, OdometryFrame::Status::kLost);
      if (scan.ends != PieceEnd::kNone) return i;
    }
    return 0;
  }
  // Where its surfaces are, all together.
  Eigen::Vector3d Surfaces() const {
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    map_.ForEachSurface(1, [&](const Surfel& surfel) { sum += surfel.centre; });
    return sum;
  }
  VoxelMap* map() { return &map_; }
  std::size_t clusters() const { return clusters_.size(); }

 private:
  Draws draws_{3};
  VoxelMap map_;
  std::vector<TimedCluster> clusters_;
  std::int64_t count_ = 0;
};

TEST(Localiser, FindsEveryScanAtOnceAndLeavesTheMapAsItIs) {
  MappedRoom room;
  const Eigen::Vector3d surfaces = room.Surfaces();
  const std::size_t bytes = room.map()->bytes();
  Localiser localiser(MappedRoom::Options(), room.map(), 0);
  localiser.Start(MappedRoom::At(0.1));
  for (int i = 0; i < 5; ++i) {
    const SE3 truth = MappedRoom::At(0.12 + 0.03 * i);
    const MapperScan scan = room.Next(truth);
    const RegisteredScan found = localiser.Process(scan);
    EXPECT_EQ(found.odometry.status, OdometryFrame::Status::kTracked);
    EXPECT_FALSE(found.keyframe);
    EXPECT_GT(room.clusters(), 0U);  // left as they are
    const Trajectory poses = localiser.TakeFinal();
    ASSERT_EQ(poses.size(), 1U);
    EXPECT_EQ(poses[0].stamp_ns, scan.stamp_ns);
    EXPECT_LT((poses[0].T_world_lidar.t - truth.t).norm(), 0.01);
    EXPECT_TRUE(localiser.final_poses().empty());
  }
  EXPECT_EQ(room.Surfaces(), surfaces);
  EXPECT_EQ(room.map()->bytes(), bytes);
}

// Between the middle of its first sweep and the stamp the sensor may have come any way.
TEST(Localiser, TheFirstPoseIsAsUncertainAsTheSpeed) {
  MappedRoom room;
  Localiser localiser(MappedRoom::Options(), room.map(), 0);
  localiser.Start(MappedRoom::At(0.1));
  for (int i = 0; i < 3; ++i) {
    MapperScan scan = room.Next(MappedRoom::At(0.1));
    scan.middle_ns = 50'000'000;
    const MatchResult match = localiser.Process(scan).odometry.match;
    const double sigma_m = std::sqrt(match.covariance.diagonal().tail<3>().maxCoeff());
    if (i == 0) {
      EXPECT_GT(match.worst_sigma_m, 0.5);
      EXPECT_GT(sigma_m, 0.5);
    } else {
      EXPECT_LT(match.worst_sigma_m, 0.05);
    }
  }
}

TEST(Localiser, LostForLongItBeginsAPieceUnlessItsStartWasGiven) {
  MappedRoom room;
  const SE3 elsewhere = MappedRoom::At(500.0);
  Localiser given(MappedRoom::Options(), room.map(), 0);
  given.Start(elsewhere);
  EXPECT_EQ(room.ScansUntilRestart(&given), 0);
  Localiser found(MappedRoom::Options(), room.map(), 0);
  found.Start(Trajectory{{0, elsewhere}, {100000000, elsewhere}});
  EXPECT_GT(room.ScansUntilRestart(&found),
            MappedRoom::Options().backend.restart_after_lost_frames);
}

}  // namespace
}  // namespace lamina
