// What commands refuse, and what they say, before results are mixed with what they are not of.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <vector>

#include "tests/support/program/run_helpers.h"
#include "tools/metrics/truth_axes.h"

namespace lamina {
namespace {

using testing::AllOf;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Not;

namespace fs = std::filesystem;

// A bend to the left, 10 m/s, ten poses a second.
Trajectory Bend(std::size_t count, double first_stamp_s = 0.0) {
  Trajectory poses;
  SE3 T;
  for (std::size_t i = 0; i < count; ++i) {
    poses.push_back(
        {static_cast<StampNs>(1e9 * first_stamp_s) + static_cast<StampNs>(i) * 100000000, T});
    T = T * SE3(ExpSO3({0.0, 0.0, 0.01}), Eigen::Vector3d(1.0, 0.0, 0.0));
  }
  return poses;
}

// The camera looks along the LiDAR's x, as KITTI's does.
SE3 CameraFromLidar() {
  Eigen::Matrix3d R;
  R << 0, -1, 0, 0, 0, -1, 1, 0, 0;
  return SE3(R, Eigen::Vector3d(0.1, -0.2, -0.3));
}

class GuardsTest : public RunTest {
 protected:
  // Mapped in a moment: a room, few points, the sensor stands still.
  std::string Room(const std::string& name, std::size_t count) const {
    static const Recording room = SyntheticRecording(synth::SceneKind::kRoom, 3, 8);
    return WriteRepeated(name, room[0].bytes, count);
  }

  std::vector<std::string> Eval(const std::string& estimate, const std::string& truth) const {
    return {"eval", "--estimate", Path(estimate), "--truth", Path(truth)};
  }

  // Fails the test unless the command is refused with that message.
  std::string Refusal(const std::vector<std::string>& arguments, int code) const {
    const Outcome outcome = Lamina(arguments);
    EXPECT_EQ(outcome.code, code) << outcome.err;
    return outcome.err;
  }
};

TEST_F(GuardsTest, ResultsAreKeptOutOfTheRecording) {
  const std::string scans = WriteRecording("street", Street(2));
  fs::create_directory_symlink(scans, Path("link"));
  for (const std::string& out : {scans, scans + "/", scans + "/velodyne", scans + "/new/folder",
                                 Path("link"), Path("link/out")}) {
    EXPECT_THAT(Refusal({"run", "--scans", scans, "--out", out}, 2),
                AllOf(HasSubstr("--out " + out), HasSubstr("in the folder of the recording")));
  }
  EXPECT_THAT(Refusal({"run", "--scans", Path("link"), "--out", scans + "/out"}, 2),
              HasSubstr("in the folder of the recording"));
  std::size_t files = 0;
  for (const auto& entry : fs::recursive_directory_iterator(scans)) {
    files += entry.is_regular_file() ? 1 : 0;
  }
  EXPECT_EQ(files, 3U);
}

TEST_F(GuardsTest, ResultsAndSessionsAreKeptApart) {
  const std::string scans = Room("room", 4);
  ASSERT_EQ(
      Lamina({"watch", "--inbox", scans, "--session", Path("session"), "--once", "--http", "off"})
          .code,
      0);
  const std::string poses = Bytes(Path("session/trajectory_tum.txt"));
  EXPECT_THAT(Refusal({"run", "--scans", scans, "--out", Path("session")}, 2),
              HasSubstr("is a session"));
  EXPECT_EQ(Bytes(Path("session/trajectory_tum.txt")), poses);
  Run(scans);
  EXPECT_THAT(
      Refusal({"watch", "--inbox", scans, "--session", Path("out"), "--once", "--http", "off"}, 2),
      HasSubstr("holds results of `lamina run`"));
  EXPECT_FALSE(fs::exists(Path("out/session.db")));
}

TEST_F(GuardsTest, ReplacedResultsAreSaidAndStaleOnesRemoved) {
  const std::string scans = Room("room", 4);
  EXPECT_THAT(Run(scans).err, Not(HasSubstr("earlier run")));
  for (const char* made : {"map.png", "cloud.ply", "map_surfels_piece3.ply", "covariance.csv"}) {
    Write(std::string("out/") + made, "of the run before");
  }
  Write("out/notes.txt", "mine");
  Write("out/map_surfels_pieces.ply", "mine");
  // What fails before it has results leaves those of before.
  const std::string summary = Bytes(Path("out/summary.json"));
  Run(scans, {"--frames", "9:"}, 2);
  Run(scans, {"--truth", Path("none.txt")}, 1);
  EXPECT_EQ(Bytes(Path("out/summary.json")), summary);
  EXPECT_TRUE(fs::exists(Path("out/cloud.ply")));
  const Outcome outcome = Run(scans, {"--frames", "0:3"});
  EXPECT_THAT(outcome.err, AllOf(HasSubstr("results of an earlier run, which will be replaced"),
                                 HasSubstr("cloud.ply"), HasSubstr("covariance.csv"),
                                 HasSubstr("map.png"), HasSubstr("map_surfels_piece3.ply")));
  EXPECT_FALSE(fs::exists(Path("out/cloud.ply")));
  EXPECT_FALSE(fs::exists(Path("out/map.png")));
  EXPECT_FALSE(fs::exists(Path("out/map_surfels_piece3.ply")));
  EXPECT_EQ(Bytes(Path("out/notes.txt")), "mine");
  EXPECT_EQ(Bytes(Path("out/map_surfels_pieces.ply")), "mine");
  EXPECT_EQ(Summary()["frames"], 3);
  // Without results of ours, such names are another program's.
  Write("other/cloud.ply", "mine");
  EXPECT_THAT(Run(scans, {}, 0, "other").err, Not(HasSubstr("removed")));
  EXPECT_EQ(Bytes(Path("other/cloud.ply")), "mine");
}

TEST_F(GuardsTest, ExportWantsTheRecordingOfTheRun) {
  const std::string scans = Room("room", 10), longer = Room("longer", 88);
  Run(scans);
  const std::vector<std::string> to{"export",       "--run", Path("out"),
                                    "--resolution", "0.5",   "--scans"};
  const auto from = [&](const std::string& other) {
    std::vector<std::string> arguments = to;
    arguments.push_back(other);
    return arguments;
  };
  EXPECT_EQ(Lamina(from(scans)).code, 0);
  EXPECT_THAT(Refusal(from(longer), 1), AllOf(HasSubstr("recording of 10 scans, this one has 88"),
                                              HasSubstr("do not belong together")));
  // As many scans with the same stamps, but others.
  const Recording street = SyntheticRecording(synth::SceneKind::kStreet, 1, 8);
  EXPECT_THAT(Refusal(from(WriteRepeated("street", street[0].bytes, 10)), 1),
              HasSubstr("usable points, the run found"));
  // Nothing but poses to go by.
  fs::remove(Path("out/frames.csv"));
  fs::remove(Path("out/summary.json"));
  EXPECT_THAT(Refusal(from(longer), 1),
              HasSubstr("10 of 10 poses have the stamp of one of the 88"));
  std::vector<std::string> among = from(scans);
  among.insert(among.end(), {"--out", scans + "/velodyne/cloud.ply"});
  EXPECT_THAT(Refusal(among, 2), HasSubstr("in the folder of the recording"));
}

TEST_F(GuardsTest, ARunWithoutPosesKeepsEarlierResults) {
  const std::string out = Path("out"), hollow = Path("hollow");
  ASSERT_EQ(Lamina({"run", "--scans", Room("room", 5), "--out", out}).code, 0);
  const std::string poses = Bytes(out + "/trajectory_tum.txt"),
                    summary = Bytes(out + "/summary.json");
  Write("hollow/1.bin", "");
  Write("hollow/2.bin", "short");
  EXPECT_THAT(
      Refusal({"run", "--scans", hollow, "--out", out}, 1),
      AllOf(HasSubstr("not one usable scan"), HasSubstr("keeps the results of an earlier run")));
  EXPECT_EQ(Bytes(out + "/trajectory_tum.txt"), poses);
  EXPECT_EQ(Bytes(out + "/summary.json"), summary);
}

TEST_F(GuardsTest, NoCommandWritesOverWhatOthersRead) {
  const std::string out = Path("out"), scans = Room("room", 5);
  ASSERT_EQ(Lamina({"run", "--scans", scans, "--out", out}).code, 0);
  const std::string table = Bytes(out + "/frames.csv");
  const auto over = [&](std::vector<std::string> arguments, const std::string& option,
                        const std::string& name) {
    arguments.insert(arguments.end(), {option, out + "/" + name});
    EXPECT_THAT(Refusal(arguments, 2), HasSubstr("is a result of the folder")) << name;
  };
  over({"export", "--run", out, "--scans", scans}, "--out", "map_surfels.ply");
  over({"export", "--run", out}, "--trajectory", "trajectory_tum.txt");
  over({"report", "--run", out}, "--out", "frames.csv");
  over({"plot", "--run", out}, "--out", "summary.json");
  over({"doctor", "--run", out}, "--out", "config.yaml");
  EXPECT_EQ(Bytes(out + "/frames.csv"), table);
  EXPECT_EQ(Lamina({"export", "--run", out, "--scans", scans}).code, 0) << "what they make";
  EXPECT_EQ(Lamina({"export", "--run", out, "--scans", scans}).code, 0) << "and make anew";
}

TEST_F(GuardsTest, FilesOfTwoRunsInOneFolderAreRefused) {
  const std::string scans = Room("room", 6);
  Run(scans);
  const std::vector<std::string> report{"report", "--run", Path("out"), "--out",
                                        Path("report.html")};
  ASSERT_EQ(Lamina(report).code, 0);
  WriteTumTrajectory(Path("out/trajectory_tum.txt"), Bend(120));
  EXPECT_THAT(Refusal(report, 1), AllOf(HasSubstr("not of one run"), HasSubstr("120 poses")));
  WriteTumTrajectory(Path("out/trajectory_tum.txt"), Bend(6, 0.03));
  EXPECT_THAT(Refusal(report, 1), HasSubstr("pose 0 has another stamp"));
}

TEST_F(GuardsTest, PosesWithoutStampsMustBeAsManyAsTheTruths) {
  WriteKittiTrajectory(Path("ten.txt"), Bend(10));
  WriteKittiTrajectory(Path("long.txt"), Bend(4541));
  EXPECT_THAT(Refusal(Eval("ten.txt", "long.txt"), 1),
              AllOf(HasSubstr("10 poses and the truth 4541"), HasSubstr("--frames")));
  std::vector<std::string> part = Eval("ten.txt", "long.txt");
  part.insert(part.end(), {"--frames", "0:10", "--json", Path("eval.json")});
  EXPECT_EQ(Lamina(part).code, 0);
  const auto json = nlohmann::json::parse(Bytes(Path("eval.json")));
  EXPECT_EQ(json["truth"][0]["poses"], 10);
  EXPECT_LT(json["truth"][0]["ape_max_m"], 1e-9);
  part[6] = "0:12";
  EXPECT_THAT(Refusal(part, 1), HasSubstr("ten.txt: has 10 poses without stamps for 12 of 4541"));
}

TEST_F(GuardsTest, EvalWantsThePosesOfTheScans) {
  const std::string scans = Room("room", 88);
  WriteKittiTrajectory(Path("ten.txt"), Bend(10));
  WriteTumTrajectory(Path("foreign.txt"), Bend(120, 5000.0));
  EXPECT_THAT(Refusal({"eval", "--estimate", Path("ten.txt"), "--scans", scans}, 1),
              HasSubstr("has 10 poses without stamps for 88 scans"));
  EXPECT_THAT(Refusal({"eval", "--estimate", Path("foreign.txt"), "--scans", scans}, 1),
              HasSubstr("0 of its 120 poses have the stamp of one of the 88 scans"));
}

TEST_F(GuardsTest, TruthsThatAreNotTheRecordingsAreRefusedBeforeTheRun) {
  const std::string scans = Room("room", 8);
  WriteKittiTrajectory(Path("short.txt"), Bend(5));
  WriteTumTrajectory(Path("foreign.txt"), Bend(120, 5000.0));
  EXPECT_THAT(Run(scans, {"--truth", Path("short.txt")}, 1).err,
              HasSubstr("short.txt: has 5 poses without stamps for 8 scans"));
  EXPECT_THAT(Run(scans, {"--truth", Path("foreign.txt")}, 1).err,
              HasSubstr("0 of its 8 poses match one of the truth's 120"));
  EXPECT_FALSE(fs::exists(Path("out")));
}

TEST_F(GuardsTest, LongerTruthsAreCutToTheScansThatWereRun) {
  const std::string scans = WriteRecording("street", Street(8));
  WriteKittiTrajectory(Path("all.txt"), Bend(8));
  WriteKittiTrajectory(Path("part.txt"), Bend(3));
  WriteKittiTrajectory(Path("long.txt"), Bend(4541));
  WriteTumTrajectory(Path("tum.txt"), Bend(4541));
  std::vector<double> errors;
  for (const char* truth : {"all.txt", "long.txt", "tum.txt"}) {
    Run(scans, {"--frames", "2:5", "--truth", Path(truth)});
    errors.push_back(Summary()["ape_rmse_m"]);
    EXPECT_DOUBLE_EQ(errors.back(), errors.front()) << truth;
  }
  EXPECT_EQ(Run(scans, {"--frames", "2:5", "--truth", Path("part.txt")}).code, 0);
  // The folder of the run knows which scans it is of.
  Write("eval.json", "");
  for (const char* truth : {"all.txt", "long.txt"}) {
    std::vector<std::string> eval = Eval("out/trajectory_kitti.txt", truth);
    eval.insert(eval.end(), {"--json", Path("eval.json")});
    ASSERT_EQ(Lamina(eval).code, 0);
    const auto json = nlohmann::json::parse(Bytes(Path("eval.json")));
    EXPECT_NEAR(json["truth"][0]["ape_rmse_m"], errors[0], 1e-6) << truth;
    EXPECT_EQ(Lamina({"report", "--run", Path("out"), "--out", Path("report.html"), "--truth",
                      Path(truth)})
                  .code,
              0);
  }
  // Names that are no numbers say nothing about lines.
  fs::rename(scans + "/velodyne/000007.bin", scans + "/velodyne/last.bin");
  EXPECT_THAT(Run(scans, {"--truth", Path("long.txt")}, 1).err, HasSubstr("has 4541 poses"));
}

TEST_F(GuardsTest, TruthInTheAxesOfACameraIsNamed) {
  WriteTumTrajectory(Path("lidar.txt"), Bend(50));
  WriteTumTrajectory(Path("camera.txt"), CameraToLidar(Bend(50), CameraFromLidar().Inverse()));
  EXPECT_THAT(Lamina(Eval("lidar.txt", "lidar.txt")).err, Not(HasSubstr("axes")));
  EXPECT_THAT(Lamina(Eval("lidar.txt", "camera.txt")).err,
              AllOf(HasSubstr("axes of a camera"), HasSubstr("calib.txt")));
  Write("calib.txt", "Tr: 0 -1 0 0.1 0 0 -1 -0.2 1 0 0 -0.3\n");
  std::vector<std::string> calibrated = Eval("lidar.txt", "camera.txt");
  calibrated.insert(calibrated.end(), {"--calib", Path("calib.txt")});
  EXPECT_THAT(Lamina(calibrated).err, Not(HasSubstr("axes")));
  const std::string scans = WriteRecording("street", Street(12));
  Run(scans);
  const Trajectory poses = ReadTrajectory(Path("out/trajectory_tum.txt"));
  WriteTumTrajectory(Path("truth.txt"), CameraToLidar(poses, CameraFromLidar().Inverse()));
  EXPECT_THAT(Run(scans, {"--truth", Path("truth.txt")}).err, HasSubstr("axes of a camera"));
}

TEST(TruthAxes, ErrorsOfTheEstimateAreNoOtherAxes) {
  const Trajectory truth = Bend(60);
  Trajectory drifts = truth, noisy = truth, stands(60);
  for (std::size_t i = 0; i < truth.size(); ++i) {
    const double sign = i % 2 == 0 ? 1.0 : -1.0;
    drifts[i].T_world_lidar.t *= 1.3;
    noisy[i].T_world_lidar.t.y() += 0.6 * sign;
  }
  for (const Trajectory& estimate : {truth, drifts, noisy, stands}) {
    EXPECT_THAT(DescribeOtherAxes({"estimate", estimate, truth}), IsEmpty());
    EXPECT_THAT(DescribeOtherAxes({"estimate", estimate, stands}), IsEmpty());
  }
  const SE3 turned(ExpSO3({0.0, 0.0, 1.5}), Eigen::Vector3d::Zero());
  EXPECT_THAT(DescribeOtherAxes({"estimate", CameraToLidar(truth, turned), truth}),
              HasSubstr("turned by 86 deg"));
}

}  // namespace
}  // namespace lamina
