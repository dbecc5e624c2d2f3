// Stations of a tilted scanner: exact poses, points on true surfaces, files that read back.
#include "tools/synth/stations.h"
#include "io/points/scan_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "io/map/trajectory_io.h"
#include "tests/support/program/run_helpers.h"
#include "tools/synth/writer.h"

namespace lamina {
namespace {

using testing::HasSubstr;

StationOptions Few(StationScene scene) {
  StationOptions options;
  options.scene = scene;
  options.scans = 4;
  options.lines = 24;
  options.ray_step = 4;
  return options;
}

class EveryStationScene : public testing::TestWithParam<StationScene> {};

TEST_P(EveryStationScene, PointsLieOnTheSurfacesWithTheNoiseOfTheSensor) {
  const StationSequence sequence(Few(GetParam()));
  const Trajectory truth = sequence.Truth();
  ASSERT_EQ(truth.size(), 4U);
  EXPECT_EQ(truth[0].T_world_lidar.t, Eigen::Vector3d::Zero());
  for (const std::size_t scan : {std::size_t{0}, std::size_t{3}}) {
    const Scan points = sequence.Read(scan);
    ASSERT_GT(points.points.size(), 2500U);
    std::size_t off = 0;
    for (const ScanPoint& p : points.points) {
      const Eigen::Vector3d at = truth[scan].T_world_lidar * Eigen::Vector3d(p.x, p.y, p.z);
      if (sequence.SurfaceDistance(at, 1.0) > 0.08) ++off;
      EXPECT_LE(std::hypot(p.x, p.y, p.z), 30.2F);
    }
    // Four standard deviations; in the apartment some points are on things that move.
    const double most = GetParam() == StationScene::kApartment ? 0.15 : 0.001;
    EXPECT_LT(static_cast<double>(off), most * static_cast<double>(points.points.size()));
  }
}

TEST_P(EveryStationScene, NeighboursStandNearAndTheWholeHasTheLengthOfTheDataSet) {
  StationOptions options = Few(GetParam());
  options.scans = 0;
  const Trajectory truth = StationSequence(options).Truth();
  EXPECT_GE(truth.size(), 30U);
  EXPECT_LE(truth.size(), 45U);
  for (std::size_t i = 1; i < truth.size(); ++i) {
    const SE3 &a = truth[i - 1].T_world_lidar, &b = truth[i].T_world_lidar;
    EXPECT_LT((a.t - b.t).norm(), 1.6) << i;
  }
}

INSTANTIATE_TEST_SUITE_P(, EveryStationScene,
                         testing::Values(StationScene::kApartment, StationScene::kHauptgebaeude,
                                         StationScene::kStairs, StationScene::kPlain,
                                         StationScene::kGazeboSummer, StationScene::kGazeboWinter,
                                         StationScene::kWoodSummer, StationScene::kWoodAutumn),
                         [](const auto& scene) {
                           return StationSceneNames()[static_cast<std::size_t>(scene.param)];
                         });

TEST(Stations, FurnitureMovesBetweenScansAndNothingElse) {
  StationOptions options = Few(StationScene::kApartment);
  options.noise_m = 0.0;
  options.scans = 20;
  const StationSequence sequence(options);
  const Trajectory truth = sequence.Truth();
  const Scan scan = sequence.Read(12);
  std::size_t on_fixed = 0;
  for (const ScanPoint& p : scan.points) {
    const Eigen::Vector3d at = truth[12].T_world_lidar * Eigen::Vector3d(p.x, p.y, p.z);
    on_fixed += sequence.SurfaceDistance(at, 1.0) < 1e-3 ? 1 : 0;
  }
  EXPECT_GT(on_fixed, scan.points.size() * 7 / 10);
  EXPECT_LT(on_fixed, scan.points.size());
}

class StationFiles : public RunTest {};

TEST_F(StationFiles, BothLayoutsHoldTheSameScansAndPoses) {
  const StationOptions options = Few(StationScene::kStairs);
  WriteStations(options, StationLayout::kKitti, Path("kitti"));
  WriteStations(options, StationLayout::kEthz, Path("ethz"));
  const auto kitti = OpenScans(Path("kitti"), {});
  const auto ethz = OpenScans(Path("ethz"), {});
  ASSERT_EQ(kitti->size(), 4U);
  ASSERT_EQ(ethz->size(), 4U);
  EXPECT_EQ(kitti->Stamp(3), ethz->Stamp(3));
  const Scan a = kitti->Read(2), b = ethz->Read(2);
  EXPECT_EQ(KittiBin(a.points), KittiBin(b.points));
  const Trajectory truth = ReadTrajectory(Path("kitti/poses.txt"));
  const Trajectory leica = ReadTrajectory(Path("ethz/pose_scanner_leica.csv"));
  EXPECT_LT(LargestDistance(truth, leica), 1e-9);
  EXPECT_EQ(Bytes(Path("kitti/reference.ply")), Bytes(Path("ethz/reference.ply")));
  EXPECT_GT(ReadScanFile(Path("ethz/reference.ply"), {}).points.size(), 2000U);
}

TEST_F(StationFiles, TheCommandSaysWhichSensorGoesWithWhichScene) {
  const Outcome wrong =
      Lamina({"synth", "--out", Path("x"), "--scene", "street", "--sensor", "utm30lx"});
  EXPECT_EQ(wrong.code, 2);
  EXPECT_THAT(wrong.err, HasSubstr("utm30lx goes with apartment"));
  const Outcome many = Lamina({"synth", "--out", Path("x"), "--scene", "plain", "--frames", "61"});
  EXPECT_EQ(many.code, 2);
  EXPECT_THAT(many.err, HasSubstr("scans"));
  const Outcome good = Lamina({"synth", "--out", Path("y"), "--scene", "plain", "--frames", "2",
                               "--lines", "10", "--layout", "ethz"});
  EXPECT_EQ(good.code, 0) << good.err;
  EXPECT_EQ(OpenScans(Path("y"), {})->size(), 2U);
}

}  // namespace
}  // namespace lamina
