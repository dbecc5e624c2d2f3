// Sessions that localise in the map of another one without being told where they begin.
#include <gtest/gtest.h>

#include "backend/loops/piece_loops.h"
#include "tests/support/program/session_scenes.h"
#include "tests/support/scenes/drifting_drive.h"

namespace lamina {
namespace {

class LocalisingTest : public SessionTest {
 protected:
  // `share`: how crooked the sensor measures (CrookedScans).
  Recording Record(const std::string& folder, const Town& town, const std::vector<SE3>& truth,
                   double share = 0.0) const {
    Recording recording;
    recording.truth = truth;
    const std::vector<Scan> scans = CrookedScans(town, truth, share);
    for (std::size_t i = 0; i < scans.size(); ++i) {
      InboxFile file;
      file.name = "scan" + std::to_string(1000 + i) + ".bin";
      file.stamp_ns = MadeUpStamp(i, {});
      if (i == 0) file.next_stamp_ns = MadeUpStamp(1, {});
      file.path = Write(folder + "/" + file.name, KittiBin(scans[i].points));
      recording.files.push_back(file);
    }
    return recording;
  }
  // The other way round, from half a lap on.
  static std::vector<SE3> Opposite() {
    std::vector<SE3> poses = Laps(1.0, 60.0);
    const SE3 half(ExpSO3({0, 0, M_PI}), {60.0, 60.0, 0.0});
    const SE3 turned(ExpSO3({0, 0, M_PI}), {0.0, 0.0, 0.0});
    for (SE3& pose : poses) pose = half * pose * turned;
    std::reverse(poses.begin(), poses.end());
    return poses;
  }
  // The largest error of those that are in the map, and how many there are.
  static std::pair<double, int> Errors(const Session& session, const std::vector<SE3>& truth,
                                       const SE3& T_true_map) {
    double worst = 0.0;
    int in_map = 0;
    session.ForEachPose([&](const FinalPose& pose) {
      if (pose.piece != 0) return;
      ++in_map;
      const SE3 T = T_true_map * pose.pose.T_world_lidar;
      worst = std::max(worst, (T.t - truth[pose.scan].t).norm());
    });
    return {worst, in_map};
  }
};

TEST_F(LocalisingTest, AVisitTheOtherWayRoundIsFoundAndResumesToTheSameBytes) {
  const Town town(1, 90.0);
  mapping_ = LapOptions(false);
  const Recording base = Record("base_scans", town, Laps(1.2, 190.0));
  FinishSession(Setup("base"), base);
  const Recording visit = Record("visit_scans", town, Opposite());
  SessionSetup whole = Setup("whole"), stopped = Setup("stopped");
  whole.base_map = stopped.base_map = BaseMap{Path("base"), whole.fixed_options, std::nullopt};
  const auto end = static_cast<std::int64_t>(visit.files.size());
  std::vector<PlaceReport> reports;
  {
    SessionHooks hooks;
    hooks.on_look = [&](const PlaceReport& report) { reports.push_back(report); };
    Session session(whole, hooks);
    Map(&session, visit, end);
    session.Finish();
    EXPECT_EQ(session.mapping().counts().found, 1U);
    EXPECT_EQ(session.mapping().counts().lost, 0U);
    const auto [worst, in_map] = Errors(session, visit.truth, base.truth[0]);
    EXPECT_GT(in_map, 20);
    EXPECT_LT(worst, 0.15);
  }
  ASSERT_GE(reports.size(), 2U);
  EXPECT_TRUE(reports.back().found.has_value());
  EXPECT_FALSE(reports.front().found.has_value());
  // Left before, at and after the scan that was found.
  const auto found_at = static_cast<std::int64_t>(reports.back().scan);
  for (const std::int64_t stop : {found_at - 4, found_at + 1})
    MapUntil(stopped, visit, stop, stop % 2 == 0 ? Leave::kAtOnce : Leave::kWhenDone);
  FinishSession(stopped, visit);
  EXPECT_EQ(Bytes(Path("stopped/trajectory_kitti.txt")), Bytes(Path("whole/trajectory_kitti.txt")));
}

TEST_F(LocalisingTest, InAMapThatLoopsHaveCorrectedAllOfItIsSearched) {
  const Town town(1, 90.0);
  mapping_ = LapOptions();
  FinishSession(Setup("base"), Record("base_scans", town, Laps(1.2, 280.0), 0.01));
  const Recording visit = Record("visit_scans", town, Opposite());
  SessionSetup setup = Setup("visit");
  setup.base_map = BaseMap{Path("base"), setup.fixed_options, std::nullopt};
  Session session(setup, {});
  EXPECT_EQ(session.mapping().loops(), nullptr);
  Map(&session, visit, static_cast<std::int64_t>(visit.files.size()));
  EXPECT_EQ(session.mapping().counts().found, 1U);
}

TEST_F(LocalisingTest, WhatTheMapDoesNotHaveStaysAPieceOfItsOwn) {
  mapping_ = LapOptions(false);
  FinishSession(Setup("base"), Record("base_scans", Town(1, 90.0), Laps(1.2, 190.0)));
  const Recording visit = Record("visit_scans", Town(7, 90.0), Opposite());
  SessionSetup setup = Setup("visit");
  setup.base_map = BaseMap{Path("base"), setup.fixed_options, std::nullopt};
  Session session(setup, {});
  Map(&session, visit, static_cast<std::int64_t>(visit.files.size()));
  EXPECT_EQ(session.mapping().counts().found, 0U);
  session.Finish();
  session.ForEachPose([](const FinalPose& pose) { EXPECT_EQ(pose.piece, 1); });
}

TEST_F(LocalisingTest, OnceFoundAndThenLostItIsAPieceOfItsOwnUntilItIsFoundAgain) {
  mapping_ = LapOptions(false);
  const Town town(1, 90.0);
  FinishSession(Setup("base"), Record("base_scans", town, Laps(1.2, 190.0)));
  // Elsewhere for a while, as if carried there and back.
  constexpr std::size_t kGone = 50, kBack = 90;
  Recording visit = Record("visit_scans", town, Laps(1.0, 150.0));
  const Recording away = Record("away_scans", Town(7, 90.0), Laps(1.0, 100.0));
  ASSERT_GT(visit.files.size(), kBack + 30);
  for (std::size_t i = kGone; i < kBack; ++i) visit.files[i].path = away.files[i].path;
  SessionSetup setup = Setup("visit");
  setup.base_map = BaseMap{Path("base"), setup.fixed_options, std::nullopt};
  Session session(setup, {});
  Map(&session, visit, static_cast<std::int64_t>(visit.files.size()));
  EXPECT_EQ(session.mapping().counts().found, 2U);
  session.Finish();
  const std::int64_t away_piece = 2;
  int away_scans = 0;
  session.ForEachPose([&](const FinalPose& pose) { away_scans += pose.piece == away_piece; });
  EXPECT_GT(away_scans, 5);
}

}  // namespace
}  // namespace lamina
