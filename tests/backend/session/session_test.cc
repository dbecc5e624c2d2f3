// Sessions: the same result as the pipeline alone, and however often they are left and continued.
#include "backend/session/session.h"
#include "backend/mapping/pipeline.h"

#include <algorithm>
#include <atomic>

#include "backend/session/checkpoint.h"
#include "tests/support/program/session_scenes.h"
#include "tests/support/scenes/bay_street.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

class SessionContinueTest : public SessionTest {
 protected:
  // Leaves after each number of scans in turn, and continues to the end; the checkpoint is under
  // way or not.
  void CheckStops(const Scene& scene, const std::vector<int>& stops) {
    const Recording recording = Record(scene);
    const Result whole = FinishSession(Setup("whole"), recording);
    for (const int stop : stops) {
      SCOPED_TRACE("left after " + std::to_string(stop) + " scans");
      const SessionSetup setup = Setup("stopped");
      fs::remove_all(setup.folder);
      MapUntil(setup, recording, stop, stop % 2 == 0 ? Leave::kAtOnce : Leave::kWhenDone);
      ExpectSame(FinishSession(setup, recording), whole);
      if (HasFailure()) return;
    }
  }
};

TEST_F(SessionContinueTest, TheResultIsThatOfThePipelineBitForBit) {
  const Recording recording = Record({});
  std::string poses;
  MappingCallbacks callbacks;
  callbacks.on_final_pose = [&](const FinalPose& pose) { poses += BytesOf(pose); };
  Mapping run(mapping_, callbacks);
  const auto source = OpenScans(Path("inbox"), {});
  ASSERT_EQ(source->size(), recording.files.size());
  MapScans(*source, {0, 0, source->size()}, &run);
  run.Finish();
  EXPECT_GT(run.counts().solves, 5U);
  EXPECT_EQ(run.counts().lost, 0U);
  const Result result = FinishSession(Setup("session"), recording);
  EXPECT_TRUE(result.poses == poses);
  EXPECT_FALSE(result.solves.empty());
  EXPECT_TRUE(result.map == BytesOf(run.map()));
  // The scene is one that can be mapped.
  std::vector<FinalPose> all;
  Session session(Setup("session"), {});
  session.ForEachPose([&](const FinalPose& pose) { all.push_back(pose); });
  ASSERT_EQ(all.size(), recording.truth.size());
  for (std::size_t i = 0; i < all.size(); ++i) {
    const SE3 truth = recording.truth[0].Inverse() * recording.truth[i];
    EXPECT_LT((all[i].pose.T_world_lidar.t - truth.t).norm(), 0.05) << "scan " << i;
  }
}

TEST_F(SessionContinueTest, LeftAfterAnyScan) {
  Scene scene;
  scene.scans = 17;
  CheckStops(scene, {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16});
}

TEST_F(SessionContinueTest, LeftAmidSkippedScans) {
  Scene scene;
  scene.scans = 17;
  scene.unreadable = {0, 4, 5, 9, 10, 11, 14, 16};  // on both sides of checkpoints, first and last
  CheckStops(scene, {1, 4, 5, 6, 9, 11, 15});
}

TEST_F(SessionContinueTest, LeftWhereAnotherSequenceBegins) {
  Scene scene;
  scene.scans = 16;
  scene.second_sequence = 10;
  CheckStops(scene, {9, 10, 11, 12});
}

TEST_F(SessionContinueTest, LeftWithBundleAdjustmentUnderWay) {
  mapping_.mapper.backend.solve_every_keyframes = 1;
  mapping_.mapper.backend.hand_over_lag_frames = 4;
  Scene scene;
  scene.scans = 17;
  CheckStops(scene, {5, 7, 8, 11, 13});
}

// What a sensor at rest keeps of its last scans, and the start that begins with them.
TEST_F(SessionContinueTest, LeftAtRestAndAfterSettingOff) {
  mapping_ = MappingOptions();
  const BayStreet street(5);
  Draws draws(3);
  Recording recording;
  for (int i = 0; i < 24; ++i) {
    constexpr double kRestS = 1.0, kHalfAcceleration = 1.5;
    SE3 T = BayStreet::PoseAt(0.0);
    T.t.x() += kHalfAcceleration * std::pow(std::max(0.0, 0.1 * i - kRestS), 2);
    InboxFile file;
    file.name = "scan" + std::to_string(1000 + i) + ".bin";
    file.stamp_ns = MadeUpStamp(static_cast<std::size_t>(i), {});
    if (i == 0) file.next_stamp_ns = MadeUpStamp(1, {});
    std::vector<ScanPoint> points;
    for (const TimedPoint& p : street.RingScan(T, 32, 720, &draws))
      points.push_back({p.x, p.y, p.z, 0.0F});
    file.path = Write("inbox/" + file.name, KittiBin(points));
    recording.truth.push_back(T);
    recording.files.push_back(file);
  }
  const Result whole = FinishSession(Setup("whole"), recording);
  for (const int stop : {11, 12, 16}) {
    SCOPED_TRACE(stop);
    SessionSetup setup = Setup("stopped");
    setup.session.checkpoint_every_scans = 1;
    fs::remove_all(setup.folder);
    MapUntil(setup, recording, stop, Leave::kWhenDone);
    ExpectSame(FinishSession(setup, recording), whole);
  }
}

// The budget is below what the scene needs: the map lives on disk for a good part.
TEST_F(SessionContinueTest, LeftWithPartsOfTheMapOnDisk) {
  mapping_.mapper.map.budget_mb = 1.0;
  mapping_.mapper.map.depth = 2;
  Scene scene;
  scene.scans = 56;
  scene.reach_m = 12.0;
  CheckStops(scene, {13, 29, 42, 51});
  TileStore tiles(Path("whole/map_tiles.db"), TileStore::Lifetime::kKept);
  EXPECT_GT(tiles.records(), 20U);
}

TEST_F(SessionContinueTest, LeftAfterEachScanOfOneSession) {
  Scene scene;
  scene.unreadable = {7, 8};
  scene.second_sequence = 15;
  const Recording recording = Record(scene);
  const Result whole = FinishSession(Setup("whole"), recording);
  const SessionSetup setup = Setup("stopped");
  for (int stop = 1; stop <= scene.scans; ++stop) {
    MapUntil(setup, recording, stop, stop % 3 == 0 ? Leave::kWhenDone : Leave::kAtOnce);
  }
  ExpectSame(FinishSession(setup, recording), whole);
}

TEST_F(SessionContinueTest, FinishedSessionsGoOn) {
  const Recording recording = Record({});
  const Result whole = FinishSession(Setup("whole"), recording);
  Recording half = recording;
  half.files.resize(13);
  const SessionSetup setup = Setup("stopped");
  FinishSession(setup, half);
  ExpectSame(FinishSession(setup, recording), whole);
  // Nothing has come: the same again.
  ExpectSame(FinishSession(setup, recording), whole);
}

TEST_F(SessionContinueTest, ScansAreRepeatedFromTheLastCheckpointOn) {
  const Recording recording = Record({});
  const SessionSetup setup = Setup("session");
  // Left in between, so that the first checkpoint is on disk when the second is due.
  MapUntil(setup, recording, 7, Leave::kWhenDone);
  MapUntil(setup, recording, 13, Leave::kWhenDone);
  ASSERT_FALSE(CheckpointsIn(setup.folder).empty());
  const std::int64_t newest = CheckpointsIn(setup.folder).front();
  EXPECT_EQ(newest, 10);
  const Session session(setup, {});
  EXPECT_EQ(session.next_scan(), newest);
  ASSERT_EQ(static_cast<std::int64_t>(session.to_repeat().size()), 13 - newest);
  for (const ScanRecord& row : session.to_repeat()) {
    EXPECT_EQ(row.file, recording.files[static_cast<std::size_t>(row.scan)].name);
  }
}

// Scans that are mapped again are in the trajectory files already: these stay as they were.
TEST_F(SessionContinueTest, TrajectoryFilesLoseNothingWhileScansAreRepeated) {
  const Recording recording = Record({});
  SessionSetup setup = Setup("session");
  setup.session.trajectory_period_s = 0.01;
  setup.session.checkpoint_every_scans = 1000;
  // A publication that is under way skips those that fall due meanwhile: on a slow disk the file
  // stands some scans behind.
  std::string kitti;
  std::int64_t mapped = 15;
  while (std::count(kitti.begin(), kitti.end(), '\n') <= 10 && mapped < 24) {
    MapUntil(setup, recording, ++mapped, Leave::kWhenDone);
    kitti = Bytes(setup.folder + "/trajectory_kitti.txt");
  }
  ASSERT_GT(std::count(kitti.begin(), kitti.end(), '\n'), 10);
  Session session(setup, {});
  ASSERT_EQ(static_cast<std::int64_t>(session.to_repeat().size()), mapped);
  Map(&session, recording, 10);
  session.WaitForHousekeeping();
  EXPECT_EQ(Bytes(setup.folder + "/trajectory_kitti.txt"), kitti);
}

TEST_F(SessionContinueTest, HooksTellEachScanOnceAndInOrder) {
  const Recording recording = Record({});
  SessionSetup setup = Setup("session");
  std::vector<std::int64_t> mapped, durable;
  std::vector<SessionCheckpoint> checkpoints;
  std::int64_t released = 0;
  SessionHooks hooks;
  hooks.on_scan = [&](const MappedScan&, const ScanRecord& row) { mapped.push_back(row.scan); };
  hooks.on_durable = [&](const ScanRecord& row) {
    durable.push_back(row.scan);
    EXPECT_TRUE(SessionDatabase(setup.folder + "/session.db", false).Knows(row.file));
  };
  hooks.on_checkpoint = [&](const SessionCheckpoint& checkpoint, std::int64_t up_to) {
    checkpoints.push_back(checkpoint);
    EXPECT_TRUE(fs::exists(setup.folder + "/" + CheckpointName(checkpoint.scans)));
    EXPECT_LE(up_to, checkpoint.scans);
    EXPECT_GE(up_to, released);
    released = up_to;
  };
  {
    Session session(setup, hooks);
    Map(&session, recording, 24);
    session.Finish();
  }
  ASSERT_EQ(mapped.size(), 24U);
  for (std::int64_t i = 0; i < 24; ++i) EXPECT_EQ(mapped[static_cast<std::size_t>(i)], i);
  EXPECT_EQ(durable, mapped);
  ASSERT_GE(checkpoints.size(), 2U);
  EXPECT_EQ(checkpoints.back().scans, 24);
  EXPECT_GT(checkpoints.back().bytes, 1000U);
  EXPECT_THAT(CheckpointsIn(setup.folder).size(), testing::AnyOf(2U, 3U));
}

TEST_F(SessionContinueTest, StoppingInTheMiddleLosesNothing) {
  const Recording recording = Record({});
  const Result whole = FinishSession(Setup("whole"), recording);
  const SessionSetup setup = Setup("stopped");
  std::atomic<bool> stop{false};
  SessionHooks hooks;
  hooks.on_scan = [&](const MappedScan&, const ScanRecord& row) { stop = row.scan >= 8; };
  {
    Session session(setup, hooks);
    StreamedScans scans = recording.From(0);
    for (const InboxFile& file : recording.files) scans.Append(file);
    session.Process(&scans, &stop);
    EXPECT_GE(session.next_scan(), 9);
    EXPECT_LT(session.next_scan(), 24);
  }
  ExpectSame(FinishSession(setup, recording), whole);
}

}  // namespace
}  // namespace lamina
