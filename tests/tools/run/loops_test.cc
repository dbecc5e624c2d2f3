// `lamina run --loops`: its files, and that nothing changes where no place is visited again.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <vector>

#include "io/map/g2o_file.h"
#include "tests/support/program/run_helpers.h"
#include "tests/support/scenes/drifting_drive.h"
#include "tools/results/run_table.h"

namespace lamina {
namespace {

class RunLoopsTest : public RunTest {};

TEST_F(RunLoopsTest, WithoutARevisitAllStaysAsItWas) {
  const std::string scans = WriteRecording("street", Street(20));
  Run(scans, {"--loops", "off"});
  const std::string trajectory = Bytes(Path("out/trajectory_kitti.txt"));
  const std::string map = Bytes(Path("out/map_surfels.ply"));
  EXPECT_FALSE(std::filesystem::exists(Path("out/loops.csv")));

  const Outcome outcome = Run(scans, {"--loops", "on", "--set", "loops.submap.length_m=5"});
  EXPECT_EQ(outcome.code, 0);
  EXPECT_EQ(Bytes(Path("out/trajectory_kitti.txt")), trajectory);
  EXPECT_EQ(Bytes(Path("out/trajectory_odometry_kitti.txt")), trajectory);
  EXPECT_EQ(Bytes(Path("out/map_surfels.ply")), map);
  EXPECT_EQ(Lines(Bytes(Path("out/loops.csv"))).size(), 1U);
  const nlohmann::json loops = Summary()["loops"];
  EXPECT_EQ(loops["accepted"], 0);
  EXPECT_GE(loops["submaps"], 3);
  const G2oGraph graph = ReadG2o(Path("out/graph.g2o"));
  EXPECT_EQ(graph.poses.size(), loops["submaps"].get<std::size_t>());
  EXPECT_EQ(graph.edges.size() + 1, graph.poses.size());
  for (const auto& entry : std::filesystem::directory_iterator(Path("out")))
    EXPECT_NE(entry.path().extension(), ".scratch");

  // They are on unless said otherwise.
  Run(scans);
  EXPECT_TRUE(std::filesystem::exists(Path("out/loops.csv")));
  // A later run without them leaves nothing of these behind.
  Run(scans, {"--loops", "off"});
  for (const char* name :
       {"loops.csv", "graph.g2o", "trajectory_odometry_kitti.txt", "trajectory_live_tum.txt"})
    EXPECT_FALSE(std::filesystem::exists(Path(std::string("out/") + name))) << name;
}

TEST_F(RunLoopsTest, ThePoseThatIsKnownAtOnceDoesNotJumpAndTheOneThatIsKnownNowIsCorrected) {
  const std::vector<SE3> truth = Laps(1.2, 280.0);
  Recording laps;
  for (const Scan& scan : CrookedScans(Town(2, 90.0), truth, 0.01))
    laps.push_back({KittiBin(scan.points), 1e-9 * static_cast<double>(scan.stamp_ns)});
  std::vector<std::string> options = {"--set", "preparation.deskew=off"};
  for (const char* set : {"backend.window.frames=8", "loops.submap.length_m=20",
                          "loops.hand_over_lag_keyframes=4", "loops.reach_m=60"})
    options.insert(options.end(), {"--set", set});
  Run(WriteRecording("laps", laps), options);
  ASSERT_GE(Summary()["loops"]["accepted"], 2);
  const Trajectory live = ReadTrajectory(Path("out/trajectory_live_tum.txt"));
  const Trajectory odometry = ReadTrajectory(Path("out/trajectory_odometry_tum.txt"));
  const Trajectory now = ReadTrajectory(Path("out/trajectory_tum.txt"));
  ASSERT_EQ(live.size(), truth.size());
  ASSERT_EQ(now.size(), truth.size());
  const auto step_off = [&](const Trajectory& poses, std::size_t i) {
    const SE3 step = poses[i - 1].T_world_lidar.Inverse() * poses[i].T_world_lidar;
    return (step.t - (truth[i - 1].Inverse() * truth[i]).t).norm();
  };
  const std::vector<RunScan> scans = ReadRunTable(Path("out")).scans;
  for (std::size_t i = 1; i < truth.size(); ++i) {
    EXPECT_LT(step_off(live, i), 0.3) << i;
    EXPECT_LT(step_off(odometry, i), 0.3) << i;
    // Each piece that nothing connects is in a frame of its own.
    const bool one_piece = scans[i].record.piece == scans[i - 1].record.piece;
    EXPECT_LT(one_piece ? step_off(now, i) : 0.0, 0.3) << i;
  }
  constexpr std::size_t kLap = 171;
  const auto lap_off = [&](const Trajectory& poses) {
    const std::size_t last = truth.size() - 1;
    const SE3 around = poses[last - kLap].T_world_lidar.Inverse() * poses[last].T_world_lidar;
    return (around.t - (truth[last - kLap].Inverse() * truth[last]).t).norm();
  };
  EXPECT_GT(lap_off(live), 1.0);
  EXPECT_LT(lap_off(now), 0.3);
}

TEST_F(RunLoopsTest, OnOrOff) { Run(WriteRecording("street", Street(3)), {"--loops", "maybe"}, 2); }

}  // namespace
}  // namespace lamina
