#include "backend/mapping/final_poses.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <optional>

#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

struct OneScan {
  StampNs stamp_ns = 0;
  bool skipped = false;
  SE3 T;  // of its own
};

// What the header says, with all scans in sight: the neighbours with a pose of their own.
std::vector<FinalPose> Reference(const std::vector<OneScan>& scans) {
  std::vector<FinalPose> result;
  for (std::size_t i = 0; i < scans.size(); ++i) {
    const OneScan* before = nullptr;
    const OneScan* after = nullptr;
    for (std::size_t k = 0; k < i; ++k) before = scans[k].skipped ? before : &scans[k];
    for (std::size_t k = scans.size(); k-- > i + 1;) after = scans[k].skipped ? after : &scans[k];
    const OneScan& scan = scans[i];
    SE3 T = scan.T;
    if (scan.skipped && before != nullptr && after != nullptr && scan.stamp_ns > before->stamp_ns &&
        scan.stamp_ns < after->stamp_ns) {
      T = Interpolate(before->T, after->T,
                      SecondsBetween(before->stamp_ns, scan.stamp_ns) /
                          SecondsBetween(before->stamp_ns, after->stamp_ns));
    } else if (scan.skipped) {
      T = before != nullptr ? before->T : after != nullptr ? after->T : SE3();
    }
    result.push_back({i, {scan.stamp_ns, T}, scan.skipped});
  }
  return result;
}

void ExpectSame(const std::vector<FinalPose>& is, const std::vector<FinalPose>& should) {
  ASSERT_EQ(is.size(), should.size());
  for (std::size_t i = 0; i < is.size(); ++i) {
    EXPECT_EQ(is[i].scan, should[i].scan);
    EXPECT_EQ(is[i].skipped, should[i].skipped) << "scan " << i;
    EXPECT_EQ(is[i].pose.stamp_ns, should[i].pose.stamp_ns) << "scan " << i;
    EXPECT_EQ(is[i].pose.T_world_lidar.t, should[i].pose.T_world_lidar.t) << "scan " << i;
    EXPECT_EQ(is[i].pose.T_world_lidar.q.coeffs(), should[i].pose.T_world_lidar.q.coeffs());
  }
}

FinalPoses Restored(FinalPoses* poses) {
  StateArchive writer;
  writer(poses);
  FinalPoses restored;
  restored.AddScan(99, 99, true);  // to be overwritten
  StateArchive reader{std::string_view(writer.written())};
  reader(&restored);
  return restored;
}

// Scans come and poses follow, in pieces of random size; sometimes the state goes through bytes.
void Check(const std::vector<OneScan>& scans, Draws* draws) {
  FinalPoses poses;
  std::vector<FinalPose> seen;
  const auto visit = [&](const FinalPose& pose) { seen.push_back(pose); };
  Trajectory open;
  std::vector<OneScan> so_far;
  for (std::size_t i = 0; i < scans.size(); ++i) {
    so_far.push_back(scans[i]);
    poses.AddScan(i, scans[i].stamp_ns, scans[i].skipped);
    if (!scans[i].skipped) open.push_back({scans[i].stamp_ns, scans[i].T});
    const auto taken = draws->Integer(0, static_cast<int>(open.size()));
    if (draws->Integer(0, 1) == 0) {
      poses.AddPoses({open.begin(), open.begin() + taken});
      poses.HandOn(0, visit);
      open.erase(open.begin(), open.begin() + taken);
    }
    if (draws->Integer(0, 3) == 0) poses = Restored(&poses);
    // What is final and what is open make up the whole, at any time.
    std::vector<FinalPose> all = seen;
    poses.ShowOpen({{0, open}}, [&](const FinalPose& pose) { all.push_back(pose); });
    ExpectSame(all, Reference(so_far));
  }
  poses.AddPoses(open);
  poses.HandOn(0, visit);
  const bool any =
      std::any_of(scans.begin(), scans.end(), [](const OneScan& s) { return !s.skipped; });
  std::vector<FinalPose> should = Reference(scans);
  while (!should.empty() && should.back().skipped) should.pop_back();
  if (!any) should.clear();
  ExpectSame(seen, should);
}

TEST(FinalPoses, EachScanGetsThePoseThatTheReferenceGivesIt) {
  Draws draws(1);
  for (int round = 0; round < 300; ++round) {
    std::vector<OneScan> scans(static_cast<std::size_t>(draws.Integer(0, 20)));
    StampNs stamp = draws.Integer(-1000, 1000);
    for (OneScan& scan : scans) {
      // Now and then stamps stand still or go back: another recording, a clock that was set.
      stamp += round % 2 == 0 ? draws.Integer(1, 1000) : draws.Integer(-500, 1000);
      scan = {stamp, draws.Integer(0, 2) == 0, draws.Pose(10.0)};
    }
    Check(scans, &draws);
  }
}

TEST(FinalPoses, SkippedScansFirstLastAndBetween) {
  Draws draws(2);
  const SE3 a(Eigen::Quaterniond::Identity(), {1.0, 0.0, 0.0});
  const SE3 b(Eigen::Quaterniond::Identity(), {3.0, 0.0, 0.0});
  const std::vector<OneScan> scans = {{10, true, {}}, {20, false, a}, {25, true, {}},
                                      {20, true, {}}, {40, false, b}, {50, true, {}}};
  Check(scans, &draws);
  const std::vector<FinalPose> poses = Reference(scans);
  const double x[] = {1.0, 1.0, 1.5, 1.0, 3.0, 3.0};
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_NEAR(poses[i].pose.T_world_lidar.t.x(), x[i], 1e-12) << "scan " << i;
  }
}

TEST(FinalPoses, OfAStreamThatIsGivenUpAllThatIsOpenIsToldSo) {
  FinalPoses poses;
  const std::vector<bool> of_stream = {true, true, false, true, false};
  for (std::size_t i = 0; i < of_stream.size(); ++i)
    poses.AddScan(i, 10 * static_cast<StampNs>(i), false, of_stream[i] ? 1 : 2);
  std::vector<bool> given_up;
  const auto visit = [&](const FinalPose& pose) { given_up.push_back(pose.given_up); };
  poses.AddPoses({{0, SE3()}}, 1);
  poses.HandOn(0, visit);  // the first one is told before
  poses.GiveUp(1);
  poses = Restored(&poses);
  poses.AddPoses({{10, SE3()}, {30, SE3()}}, 1);
  poses.AddPoses({{20, SE3()}, {40, SE3()}}, 2);
  poses.HandOn(0, visit);
  EXPECT_EQ(given_up, std::vector<bool>({false, true, false, true, false}));
}

TEST(FinalPoses, IfAllScansAreSkippedTheyStandAtTheOrigin) {
  FinalPoses poses;
  poses.AddScan(7, 70, true);
  int count = 0;
  poses.ShowOpen({}, [&](const FinalPose& pose) {
    ++count;
    EXPECT_EQ(pose.scan, 7U);
    EXPECT_TRUE(pose.skipped);
    EXPECT_EQ(pose.pose.T_world_lidar.t, Eigen::Vector3d::Zero());
  });
  EXPECT_EQ(count, 1);
}

}  // namespace
}  // namespace lamina
