// `lamina register` through the program.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <random>

#include "tests/support/program/run_helpers.h"

namespace lamina {
namespace {

using testing::HasSubstr;

constexpr std::size_t kStreetScans = 8;

class RegisterTest : public RunTest {
 protected:
  // Poses along the street as the generator drives it, shaken a little; the first is exact.
  Trajectory StartPoses(double off_m) const {
    SynthOptions options;
    options.frames = 40;
    options.sensor = synth::SensorKind::kVlp16;
    options.scene = synth::SceneKind::kStreet;
    const SynthSequence sequence(options);
    std::mt19937 random(1);
    std::uniform_real_distribution<double> draw(-off_m, off_m);
    Trajectory poses;
    const SE3 T_first_world = sequence.TruePose(0).Inverse();
    for (std::size_t i = 0; i < kStreetScans; ++i) {
      StampedPose pose{sequence.Stamp(i), T_first_world * sequence.TruePose(i)};
      if (i > 0) pose.T_world_lidar.t += Eigen::Vector3d(draw(random), draw(random), draw(random));
      poses.push_back(pose);
    }
    return poses;
  }

  std::string WritePoses(const std::string& name, const Trajectory& poses) const {
    WriteKittiTrajectory(Path(name), poses);
    return Path(name);
  }

  Outcome Register(const std::string& initial, std::vector<std::string> more = {}, int code = 0) {
    std::vector<std::string> arguments{
        "register",  "--scans", WriteRecording("street", Street(kStreetScans)),
        "--initial", initial,   "--out",
        Path("out")};
    arguments.insert(arguments.end(), more.begin(), more.end());
    Outcome outcome = Lamina(arguments);
    EXPECT_EQ(outcome.code, code) << outcome.err;
    return outcome;
  }
};

// Covariances are those of a minimum.
TEST_F(RegisterTest, ClaimsNoCovariancesOfPosesThatHaveNotSettled) {
  Register(WritePoses("start.txt", StartPoses(0.15)), {"--set", "registration.rounds=1"});
  const nlohmann::json summary = Summary();
  EXPECT_EQ(summary["status"], "round_limit");
  EXPECT_THAT(summary["covariance_failure"].get<std::string>(), HasSubstr("registration.rounds"));
  EXPECT_FALSE(std::filesystem::exists(Path("out/covariance.csv")));
}

TEST_F(RegisterTest, BringsAStreetTogetherAndWritesEverything) {
  const Trajectory truth = StartPoses(0.0);
  const std::string truth_file = WritePoses("truth.txt", truth);
  const Outcome outcome =
      Register(WritePoses("start.txt", StartPoses(0.15)), {"--truth", truth_file});
  EXPECT_LT(LargestDistance(AllScans(), truth), 0.03);
  const nlohmann::json summary = Summary();
  for (const char* key :
       {"cost_initial", "cost_final", "iterations", "solve_s", "build_s", "planes",
        "peak_rss_bytes", "status", "formulation", "ape_rmse_m", "faults"}) {
    EXPECT_TRUE(summary.contains(key)) << key;
  }
  EXPECT_LT(summary["first_round_cost_final"], summary["first_round_cost_initial"]);
  const std::vector<std::string> rounds = Lines(Bytes(Path("out/rounds.csv")));
  EXPECT_THAT(rounds.at(0), testing::StartsWith("round,iteration,cost,step,planes,ms"));
  EXPECT_EQ(rounds.size(), 1U + summary["iterations"].get<std::size_t>());
  EXPECT_EQ(Lines(Bytes(Path("out/covariance.csv"))).size(), 1 + kStreetScans);
  EXPECT_THAT(Bytes(Path("out/map_surfels.ply")), testing::StartsWith("ply"));
  EXPECT_THAT(Bytes(Path("out/config.yaml")), HasSubstr("registration:"));
  EXPECT_THAT(outcome.out, HasSubstr("against the truth"));
}

TEST_F(RegisterTest, SameBytesAtAnyNumberOfThreads) {
  const std::string start = WritePoses("start.txt", StartPoses(0.1));
  Register(start, {"--threads", "1"});
  const std::string poses = Bytes(Path("out/trajectory_kitti.txt"));
  const std::string map = Bytes(Path("out/map_surfels.ply"));
  Register(start, {"--threads", "4"});
  EXPECT_EQ(Bytes(Path("out/trajectory_kitti.txt")), poses);
  EXPECT_EQ(Bytes(Path("out/map_surfels.ply")), map);
}

TEST_F(RegisterTest, FormulationsOfOneCostEndTogether) {
  const std::string start = WritePoses("start.txt", StartPoses(0.05));
  std::vector<double> costs;
  for (const char* name : {"condensed", "evm2", "evm1"}) {
    Register(start, {"--formulation", name, "--set", "registration.rounds=1", "--set",
                     "registration.solver.min_cost_change=1e-13"});
    EXPECT_EQ(Summary()["formulation"], name);
    costs.push_back(Summary()["cost_final"]);
  }
  EXPECT_NEAR(costs[1], costs[0], 1e-8 * costs[0]);
  // The points stand where float32 left them, the clusters' sums do not round.
  EXPECT_NEAR(costs[2], costs[0], 1e-5 * costs[0]);
}

TEST_F(RegisterTest, APoseFileOfAnotherLengthIsRefused) {
  Trajectory poses = StartPoses(0.0);
  poses.pop_back();
  EXPECT_THAT(Register(WritePoses("short.txt", poses), {}, 1).err,
              testing::AllOf(HasSubstr("short.txt: holds 7 poses for 8 scans"),
                             HasSubstr("add --frames 0:7")));
  poses.push_back(poses.back());
  poses.push_back(poses.back());
  EXPECT_THAT(Register(WritePoses("long.txt", poses), {}, 1).err,
              HasSubstr("long.txt: holds 9 poses for 8 scans"));
}

// Odometry that has missed scans: its stamps tell which.
TEST_F(RegisterTest, PosesWithStampsMayMissScans) {
  const Trajectory truth = StartPoses(0.0);
  Trajectory poses = StartPoses(0.1);
  poses.erase(poses.begin() + 3);
  poses.pop_back();
  WriteTumTrajectory(Path("odometry.txt"), poses);
  const Outcome outcome = Register(Path("odometry.txt"));
  EXPECT_THAT(outcome.err, HasSubstr("skipped scan 7: it has no initial pose"));
  EXPECT_EQ(Summary()["skipped_scans"], 1);
  Trajectory found = AllScans();
  ASSERT_EQ(found.size(), kStreetScans);
  // Scan 3 began between its neighbours.
  EXPECT_LT(LargestDistance({found.begin(), found.end() - 1}, {truth.begin(), truth.end() - 1}),
            0.03);
}

// Not the order in the file, though they are as many as the scans.
TEST_F(RegisterTest, PosesWithStampsAreThoseOfTheirScans) {
  Trajectory poses = StartPoses(0.1);
  WriteTumTrajectory(Path("ordered.txt"), poses);
  Register(Path("ordered.txt"));
  const std::string found = Bytes(Path("out/trajectory_tum.txt"));
  std::reverse(poses.begin(), poses.end());
  WriteTumTrajectory(Path("reversed.txt"), poses);
  Register(Path("reversed.txt"));
  EXPECT_EQ(Bytes(Path("out/trajectory_tum.txt")), found);
  for (StampedPose& pose : poses) pose.stamp_ns += 1'000'000'000'000;
  WriteTumTrajectory(Path("other.txt"), poses);
  EXPECT_THAT(Register(Path("other.txt"), {}, 1).err, HasSubstr("no scan has its stamp among"));
}

// As on a national grid.
TEST_F(RegisterTest, PosesFarFromTheOriginAreAsGood) {
  const Eigen::Vector3d grid(500'000.0, 5'400'000.0, 300.0);
  Trajectory poses = StartPoses(0.15), truth = StartPoses(0.0);
  for (Trajectory* trajectory : {&poses, &truth}) {
    for (StampedPose& pose : *trajectory) pose.T_world_lidar.t += grid;
  }
  Register(WritePoses("grid.txt", poses));
  EXPECT_LT(LargestDistance(AllScans(), truth), 0.03);
  EXPECT_EQ(Summary()["map_origin_m"], nlohmann::json({500000.0, 5400000.0, 300.0}));
  EXPECT_GT(Summary()["planes"], 100);
}

TEST_F(RegisterTest, ARangeTakesItsPosesFromEitherFile) {
  const Trajectory all = StartPoses(0.05);
  Register(WritePoses("all.txt", all), {"--frames", "2:6"});
  const std::string poses = Bytes(Path("out/trajectory_kitti.txt"));
  EXPECT_EQ(Lines(poses).size(), 4U);
  Register(WritePoses("part.txt", {all.begin() + 2, all.begin() + 6}), {"--frames", "2:6"});
  EXPECT_EQ(Bytes(Path("out/trajectory_kitti.txt")), poses);
}

TEST_F(RegisterTest, PosesThatAreNoneAreRefusedWithTheirLine) {
  std::string text = Bytes(WritePoses("good.txt", StartPoses(0.0)));
  std::vector<std::string> lines = Lines(text);
  const auto with = [&](const std::string& third) {
    lines[2] = third;
    std::string all;
    for (const std::string& line : lines) all += line + "\n";
    Write("bad.txt", all);
    return Register(Path("bad.txt"), {}, 1).err;
  };
  EXPECT_THAT(with("2 0 0 0 0 1 0 0 0 0 1 0"),
              testing::AllOf(HasSubstr("bad.txt:3"), HasSubstr("must be a rotation")));
  EXPECT_THAT(with("nan 0 0 0 0 1 0 0 0 0 1 0"),
              testing::AllOf(HasSubstr("bad.txt:3"), HasSubstr("finite")));
}

TEST_F(RegisterTest, OneScanAloneIsRefusedWithAReason) {
  const Outcome outcome =
      Register(WritePoses("start.txt", StartPoses(0.0)), {"--frames", "3:4"}, 1);
  EXPECT_THAT(outcome.err, HasSubstr("ill-posed"));
  EXPECT_EQ(Summary()["status"], "ill_posed");
  EXPECT_EQ(AllScans().size(), 1U);
}

TEST_F(RegisterTest, AnEmptyScanKeepsItsPoseAndTheRestIsSolved) {
  Recording recording = Street(kStreetScans);
  recording[4].bytes = recording[4].bytes.substr(0, 160);
  const Trajectory start = StartPoses(0.1);
  const Outcome outcome =
      Lamina({"register", "--scans", WriteRecording("holed", recording), "--initial",
              WritePoses("start.txt", start), "--out", Path("out")});
  EXPECT_EQ(outcome.code, 0) << outcome.err;
  EXPECT_THAT(outcome.err, HasSubstr("skipped scan 4"));
  EXPECT_EQ(Summary()["skipped_scans"], 1);
  const Trajectory poses = AllScans();
  ASSERT_EQ(poses.size(), kStreetScans);
  EXPECT_LT((poses[4].T_world_lidar.t - start[4].T_world_lidar.t).norm(), 1e-9);
  EXPECT_LT((poses[5].T_world_lidar.t - StartPoses(0.0)[5].T_world_lidar.t).norm(), 0.03);
}

TEST_F(RegisterTest, AnUnknownFormulationIsWrongUsage) {
  EXPECT_THAT(Register(WritePoses("start.txt", StartPoses(0.0)), {"--formulation", "best"}, 2).err,
              HasSubstr("condensed"));
}

TEST_F(RegisterTest, HandHeldRecordingGetsThinnerPlanesAndStaysClosed) {
  const char* recordings = std::getenv("LAMINA_RECORDINGS");
  if (recordings == nullptr) GTEST_SKIP() << "LAMINA_RECORDINGS is not set";
  const std::string folder = std::string(recordings) + "/hku1_avia";
  const Outcome outcome =
      Lamina({"register", "--scans", folder, "--initial", folder + "/poses_odometry.txt",
              "--config", std::string(LAMINA_SOURCE_DIR) + "/config/livox_avia.yaml", "--out",
              Path("out"), "--set", "registration.rounds=3"});
  ASSERT_EQ(outcome.code, 0) << outcome.err;
  const Trajectory poses = AllScans();
  EXPECT_LT((poses.back().T_world_lidar.t - poses.front().T_world_lidar.t).norm(), 0.08);
  const Outcome judged =
      Lamina({"eval", "--estimate", Path("out/trajectory_kitti.txt"), "--scans", folder, "--other",
              "odometry=" + folder + "/poses_odometry.txt", "--other",
              "reference=" + folder + "/poses_reference.txt", "--json", Path("quality.json")});
  ASSERT_EQ(judged.code, 0) << judged.err;
  const auto quality = nlohmann::json::parse(Bytes(Path("quality.json")));
  SCOPED_TRACE(quality.dump());
  std::vector<double> thickness;
  for (const auto& entry : quality["map_quality"]["trajectories"]) {
    thickness.push_back(entry["common_thickness_mm"]);
  }
  ASSERT_EQ(thickness.size(), 3U);
  EXPECT_LT(thickness[0], thickness[1]);
  EXPECT_LT(thickness[0], thickness[2]);
}

}  // namespace
}  // namespace lamina
