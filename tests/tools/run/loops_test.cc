// `lamina run --loops`: its files, and that nothing changes where no place is visited again.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <string>

#include "io/map/g2o_file.h"
#include "tests/support/run_helpers.h"

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

  // A later run without them leaves nothing of these behind.
  Run(scans);
  for (const char* name :
       {"loops.csv", "graph.g2o", "trajectory_odometry_kitti.txt", "trajectory_live_tum.txt"})
    EXPECT_FALSE(std::filesystem::exists(Path(std::string("out/") + name))) << name;
}

TEST_F(RunLoopsTest, OnOrOff) { Run(WriteRecording("street", Street(3)), {"--loops", "maybe"}, 2); }

}  // namespace
}  // namespace lamina
