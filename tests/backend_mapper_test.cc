#include "backend/mapper.h"

#include <gtest/gtest.h>

#include "tests/random_rooms.h"

namespace lamina {
namespace {

constexpr int kWindow = 4;
const Eigen::Vector3d kShift(0.01, 0.0, 0.0);

// A mapper that goes through a room, a keyframe for each scan.
class Walk {
 public:
  Walk() : mapper_(Options()) {}

  void Process(int scans) {
    for (int i = 0; i < scans; ++i, ++count_) {
      const SE3 T(Eigen::Quaterniond::Identity(), {0.02 * count_, 0.0, 0.0});
      const MappedFrame frame =
          mapper_.Process(count_ * StampNs{100000000},
                          ScanFrom(T, World::Room().Sample(2000, 0.005, &draws_), kLeafM));
      EXPECT_TRUE(frame.keyframe);
    }
  }
  // A solve's result that moves every frame of the window by kShift.
  BundleResult Shifted() {
    BundleResult result;
    result.status = BundleResult::Status::kConverged;
    for (const SE3& T : mapper_.PrepareSolve().poses) result.poses.emplace_back(T.q, T.t + kShift);
    return result;
  }
  // How far each frame moves when the result is taken in.
  std::vector<double> Apply(const BundleResult& result) {
    const Trajectory before = mapper_.OpenFrames();
    mapper_.ApplySolve(result);
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
    options.backend.keyframe_translation_m = 0.0;
    EXPECT_EQ(options.map.LeafSize(), kLeafM);
    return options;
  }

  Draws draws_{1};
  Mapper mapper_;
  int count_ = 0;
};

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

TEST(Mapper, ASolveOfFramesThatHaveAllLeftChangesNothing) {
  Walk walk;
  walk.Process(kWindow);
  const BundleResult result = walk.Shifted();
  walk.Process(kWindow);
  for (const double moved : walk.Apply(result)) EXPECT_EQ(moved, 0.0);
}

}  // namespace
}  // namespace lamina
