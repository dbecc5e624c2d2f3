#include "backend/pieces/mapper.h"

#include <gmock/gmock.h>

#include <cmath>
#include <string>
#include <utility>

#include "core/base/error.h"
#include "tests/support/scenes/random_rooms.h"

namespace lamina {
namespace {

constexpr int kWindow = 4;
const Eigen::Vector3d kShift(0.01, 0.0, 0.0);

// A mapper that goes through a room, a keyframe for each scan.
class Walk {
 public:
  Walk() : map_(Options().map), mapper_(Options(), &map_, 0) {}

  // `middle_ns`: how long after its stamp each scan was in the middle of its sweep; 0 takes it at
  // one instant.
  void Process(int scans, StampNs middle_ns = 0) {
    for (int i = 0; i < scans; ++i, ++count_) {
      const SE3 T(Eigen::Quaterniond::Identity(), {0.02 * count_, 0.0, 0.0});
      std::vector<TimedCluster> clusters =
          ScanFrom(T, World::Room().Sample(2000, 0.005, &draws_), kLeafM);
      for (std::size_t k = 0; middle_ns != 0 && k < clusters.size(); ++k) {
        const Eigen::Vector3d& p = clusters[k].points.mean;
        clusters[k].mean_time_s = 0.1 * std::atan2(p.y(), p.x()) / (2.0 * M_PI);
      }
      const RegisteredScan frame =
          mapper_.Process({count_, count_ * StampNs{100000000}, false, &clusters, middle_ns});
      EXPECT_TRUE(frame.keyframe);
    }
  }
  Mapper& mapper() { return mapper_; }
  const VoxelMap& map() const { return map_; }
  // A solve's result that moves every frame of the window by kShift.
  BundleResult Shifted() {
    BundleResult result;
    result.status = BundleResult::Status::kConverged;
    for (const SE3& T : mapper_.PrepareSolve().poses) result.poses.emplace_back(T.q, T.t + kShift);
    return result;
  }
  // How far each frame moves when the result is taken in, which must be told whether it is of use.
  std::vector<double> Apply(const BundleResult& result, bool of_use = true) {
    const Trajectory before = mapper_.OpenFrames();
    EXPECT_EQ(mapper_.ApplySolve(result), of_use);
    const Trajectory after = mapper_.OpenFrames();
    std::vector<double> moved;
    for (std::size_t i = 0; i < before.size(); ++i) {
      moved.push_back((after[i].T_world_lidar.t - before[i].T_world_lidar.t).norm());
    }
    return moved;
  }

 private:
  static constexpr double kLeafM = 0.8;
  static MapperOptions Options() {
    MapperOptions options;
    options.backend.window.frames = kWindow;
    options.backend.hand_over_lag_frames = kWindow - 1;
    options.backend.keyframe_translation_m = 0.0;
    EXPECT_EQ(options.map.LeafSize(), kLeafM);
    return options;
  }

  Draws draws_{1};
  VoxelMap map_;
  Mapper mapper_;
  int count_ = 0;
};

TEST(Mapper, TheFirstScanIsAtTheStartAtItsStamp) {
  Walk walk;
  walk.Process(3, 50000000);
  const Trajectory poses = walk.mapper().OpenFrames();
  ASSERT_EQ(poses.size(), 3U);
  EXPECT_LT(poses[0].T_world_lidar.t.norm(), 0.005);
  for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ(poses[i].stamp_ns, StampNs{100000000} * StampNs(i));
}

TEST(Mapper, AFirstPoseThatIsFinalStays) {
  Walk walk;
  walk.Process(1, 50000000);
  const Trajectory first = walk.mapper().TakeFinal(1);
  ASSERT_EQ(first.size(), 1U);
  EXPECT_TRUE(first[0].T_world_lidar.t.isZero());
  EXPECT_TRUE(walk.mapper().OpenFrames().empty());
  walk.Process(3, 50000000);
  EXPECT_EQ(walk.mapper().OpenFrames().size(), 3U);
}

TEST(Mapper, ASolveMovesTheWindowAndWhatHasJoinedIt) {
  Walk walk;
  walk.Process(kWindow);
  const BundleResult result = walk.Shifted();
  for (const double moved : walk.Apply(result)) EXPECT_NEAR(moved, kShift.norm(), 1e-9);
}

TEST(Mapper, FramesThatLeftDuringASolveStayWhereTheMapHasThem) {
  Walk walk;
  walk.Process(kWindow);
  const BundleResult result = walk.Shifted();
  walk.Process(2);
  const std::vector<double> moved = walk.Apply(result);
  ASSERT_EQ(moved.size(), kWindow + 2U);
  for (std::size_t i = 0; i < moved.size(); ++i) {
    EXPECT_NEAR(moved[i], i < 2 ? 0.0 : kShift.norm(), 1e-9) << "frame " << i;
  }
}

TEST(Mapper, KeyframesAreToldWhenTheyLeaveTheWindow) {
  Walk walk;
  std::vector<FinalKeyframe> told;
  walk.mapper().SetOnFinalKeyframe([&](std::int64_t piece, const FinalKeyframe& keyframe) {
    EXPECT_EQ(piece, 0);
    told.push_back(keyframe);
  });
  walk.Process(kWindow + 2);
  ASSERT_EQ(told.size(), 2U);
  walk.Apply(walk.Shifted());
  walk.Process(1);
  walk.mapper().Close();
  ASSERT_EQ(told.size(), kWindow + 3U);
  const Trajectory final = walk.mapper().TakeFinal(1000);
  double most = 0.0;
  for (std::size_t i = 0; i < told.size(); ++i) {
    EXPECT_EQ(told[i].id, static_cast<std::int64_t>(i));
    EXPECT_EQ(told[i].stamp_ns, final[i].stamp_ns);
    EXPECT_EQ(told[i].T_world_lidar.t, final[i].T_world_lidar.t);
    for (const PointCluster& cluster : told[i].clusters) most = std::max(most, cluster.count);
    // What it leaves lies where the map has it.
    EXPECT_NE(walk.map().FindSurface(told[i].clusters[0].mean), VoxelMap::kNoNode);
  }
  EXPECT_LE(most, 8.0);
}

TEST(Mapper, ASolveOfFramesThatHaveAllLeftChangesNothingAndSaysSo) {
  Walk walk;
  walk.Process(kWindow);
  const BundleResult result = walk.Shifted();
  walk.Process(kWindow);
  for (const double moved : walk.Apply(result, false)) EXPECT_EQ(moved, 0.0);
}

// The clusters of one sight of a room, as often as wanted: a sensor that stands still.
class Parked {
 public:
  explicit Parked(const BackendOptions& backend)
      : map_(Options(backend).map), mapper_(Options(backend), &map_, 0) {
    Draws draws(2);
    clusters_ =
        ScanFrom(SE3(), World::Room().Sample(400, 0.005, &draws), map_.options().LeafSize());
  }

  void Stand(int scans) {
    for (int i = 0; i < scans; ++i, ++count_) {
      std::vector<TimedCluster> clusters = clusters_;
      const RegisteredScan frame =
          mapper_.Process({count_, count_ * StampNs{100000000}, false, &clusters});
      keyframes_ += frame.keyframe ? 1 : 0;
      final_ += mapper_.TakeFinal(count_ + 1 - kFinalAfter).size();
    }
  }
  std::size_t StateBytes() {
    StateArchive a;
    a(&mapper_);
    return a.written().size();
  }
  int Surfels() const {
    int surfels = 0;
    map_.ForEachSurface(BackendOptions().min_surfel_frames, [&](const Surfel&) { ++surfels; });
    return surfels;
  }

  static constexpr int kFinalAfter = 40;
  VoxelMap map_;
  Mapper mapper_;
  int count_ = 0, keyframes_ = 0;
  std::size_t final_ = 0;

 private:
  static MapperOptions Options(const BackendOptions& backend) {
    MapperOptions options;
    options.backend = backend;
    return options;
  }
  std::vector<TimedCluster> clusters_;
};

TEST(Mapper, WhatAStandingSensorKeepsDoesNotGrow) {
  BackendOptions options;
  options.keyframe_after_frames = 30;
  Parked parked(options);
  parked.Stand(720);
  const std::size_t bytes = parked.StateBytes(), map_bytes = parked.map_.bytes();
  EXPECT_EQ(parked.mapper_.OpenFrames().size(), std::size_t{Parked::kFinalAfter});
  parked.Stand(3000);
  EXPECT_EQ(parked.mapper_.OpenFrames().size(), std::size_t{Parked::kFinalAfter});
  EXPECT_EQ(parked.final_, 3720U - Parked::kFinalAfter);
  EXPECT_EQ(parked.StateBytes(), bytes);
  EXPECT_EQ(parked.map_.bytes(), map_bytes);
}

TEST(Mapper, AStandingSensorMakesAMap) {
  BackendOptions options;
  Parked parked(options);
  // However short the recording: the first frames are keyframes, as many as a surfel needs.
  parked.Stand(options.min_surfel_frames);
  EXPECT_EQ(parked.keyframes_, options.min_surfel_frames);
  EXPECT_GT(parked.Surfels(), 10);
  parked.Stand(options.keyframe_after_frames - 1);
  EXPECT_EQ(parked.keyframes_, options.min_surfel_frames);
  parked.Stand(1);
  EXPECT_EQ(parked.keyframes_, options.min_surfel_frames + 1);
}

TEST(Mapper, OptionsThatSwitchBundleAdjustmentOffAreRefused) {
  using testing::AllOf;
  using testing::HasSubstr;
  const auto complaint = [](int frames, int lag, bool enabled) -> std::string {
    MapperOptions options;
    options.backend.window.frames = frames;
    options.backend.hand_over_lag_frames = lag;
    options.backend.enabled = enabled;
    try {
      VoxelMap map(options.map);
      const Mapper mapper(options, &map, 0);
    } catch (const OptionError& error) {
      return error.what();
    }
    return "";
  };
  for (const int lag : {15, 40}) {
    EXPECT_THAT(complaint(15, lag, true),
                AllOf(HasSubstr("backend.hand_over_lag_frames = " + std::to_string(lag)),
                      HasSubstr("backend.window.frames = 15")));
  }
  EXPECT_THAT(complaint(2, 0, true),
              AllOf(HasSubstr("backend.window.frames = 2"), HasSubstr("backend.enabled")));
  EXPECT_EQ(complaint(15, 14, true), "");
  EXPECT_EQ(complaint(3, 2, true), "");
  EXPECT_EQ(complaint(2, 40, false), "");
}

// A second leaves the heading in a square room open by quarter turns.
TEST(Mapper, WhereAScanMayBeInsteadIsInItsCovarianceAndMakesItDegenerate) {
  for (const auto& [room, open] : {std::pair{World::Square(), true}, {World::Room(), false}}) {
    const MapperOptions options;
    VoxelMap map(options.map);
    Mapper mapper(options, &map, 0);
    Draws draws(1);
    RegisteredScan last;
    for (int i = 0; i < 2; ++i) {
      std::vector<TimedCluster> clusters =
          ScanFrom(SE3(), room.Sample(3000, 0.005, &draws), options.map.LeafSize());
      last = mapper.Process({i, i * StampNs{1000000000}, false, &clusters, 0});
    }
    ASSERT_EQ(last.odometry.status, OdometryFrame::Status::kTracked);
    EXPECT_EQ(last.odometry.match.degenerate > 0, open);
    EXPECT_EQ(std::sqrt(last.odometry.match.covariance(2, 2)) > 1.0, open);  // rad
  }
}

}  // namespace
}  // namespace lamina
