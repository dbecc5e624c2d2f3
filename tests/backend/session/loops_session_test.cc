// Sessions whose map is corrected by loops: left and continued around corrections.
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "backend/loops/piece_loops.h"
#include "tests/support/program/session_scenes.h"
#include "tests/support/scenes/drifting_drive.h"

namespace lamina {
namespace {

class LoopsSessionTest : public SessionTest {
 protected:
  // Scans of a town from there, with half a minute of darkness before the `dark`th.
  Recording RecordTown(std::vector<SE3> truth, double share, std::size_t dark,
                       double points_per_m2 = 4.0) const {
    constexpr StampNs kDarkNs = 30'000'000'000;
    const Town town(1, 90.0);
    Recording recording;
    recording.truth = std::move(truth);
    const std::vector<Scan> scans = CrookedScans(town, recording.truth, share, points_per_m2);
    for (std::size_t i = 0; i < scans.size(); ++i) {
      InboxFile file;
      file.name = "scan" + std::to_string(1000 + i) + ".bin";
      file.stamp_ns = MadeUpStamp(i, {}) + (i < dark ? 0 : kDarkNs);
      if (i == 0) file.next_stamp_ns = MadeUpStamp(1, {});
      file.path = Write("inbox/" + file.name, KittiBin(scans[i].points));
      recording.files.push_back(file);
    }
    return recording;
  }
};

TEST_F(LoopsSessionTest, LeftAroundCorrections) {
  mapping_ = LapOptions();
  const std::vector<SE3> laps = Laps(1.2, 280.0);
  const Recording recording = RecordTown(laps, 0.01, laps.size());
  SessionSetup whole = Setup("whole"), stopped = Setup("stopped");
  whole.session.checkpoint_every_scans = stopped.session.checkpoint_every_scans = 3;
  const Result result = FinishSession(whole, recording);
  // Corrections are due so many scans after a submap of 20 m is complete: some stops fall between,
  // with the work under way.
  for (const std::int64_t stop : {150, 194, 197, 199, 200, 201, 203, 205, 212, 219})
    MapUntil(stopped, recording, stop, stop % 2 == 0 ? Leave::kAtOnce : Leave::kWhenDone);
  // Counted while mapping: how far back the last checkpoint lies is a matter of the disk's speed.
  {
    Session session(stopped, {});
    Map(&session, recording, 228);
    EXPECT_GT(session.mapping().loops()->corrections(), 0);
    session.WaitForHousekeeping();
  }
  ExpectSame(FinishSession(stopped, recording), result);
  // Without the end of what its submaps hold no checkpoint can be used: all is mapped again.
  std::filesystem::resize_file(Path("stopped/submap_leaves.bin"), 100);
  SessionSetup cut = Setup("stopped");
  ExpectSame(FinishSession(cut, recording), result);
  // What is published is corrected: the drift of a lap is gone from it.
  const Trajectory published = ReadTrajectory(Path("whole/trajectory_tum.txt"));
  ASSERT_EQ(published.size(), recording.truth.size());
  const std::size_t lap = 171, last = published.size() - 1;
  const SE3 around = published[last - lap].T_world_lidar.Inverse() * published[last].T_world_lidar;
  const SE3 truth = recording.truth[last - lap].Inverse() * recording.truth[last];
  EXPECT_LT((around.t - truth.t).norm(), 0.3);
}

TEST_F(LoopsSessionTest, LeftAmongTrimmedSubmaps) {
  mapping_ = LapOptions();
  mapping_.loops.kept_visits = 1;
  // Two rounds of 206 m and more than a half: of the first places the second visit goes.
  const std::vector<SE3> laps = Laps(1.2, 550.0);
  const Recording recording = RecordTown(laps, 0.005, laps.size(), 3.0);
  SessionSetup whole = Setup("whole"), stopped = Setup("stopped");
  whole.session.checkpoint_every_scans = stopped.session.checkpoint_every_scans = 20;
  const Result result = FinishSession(whole, recording);
  for (const std::int64_t stop : {400, 452})
    MapUntil(stopped, recording, stop, stop == 400 ? Leave::kAtOnce : Leave::kWhenDone);
  {
    Session session(stopped, {});
    const LoopClosure& loops = *session.mapping().loops()->pieces().at(0);
    EXPECT_GT(loops.trimmed().size(), 2U);
    for (const Submap& submap : loops.submaps()) EXPECT_GT(submap.Leaves().size(), 0U);
    // Their room on the disk is given back.
    struct stat status {};
    ASSERT_EQ(stat(Path("stopped/submap_leaves.bin").c_str(), &status), 0);
    EXPECT_LT(512 * status.st_blocks, status.st_size);
    session.WaitForHousekeeping();
  }
  ExpectSame(FinishSession(stopped, recording), result);
  const Trajectory published = ReadTrajectory(Path("whole/trajectory_tum.txt"));
  ASSERT_EQ(published.size(), recording.truth.size());
  // A round later the sensor is found to be where it was, trimmed submap or not.
  const std::size_t lap = 171;
  for (std::size_t i = lap; i < published.size(); i += 10) {
    const SE3 around = published[i - lap].T_world_lidar.Inverse() * published[i].T_world_lidar;
    const SE3 truth = recording.truth[i - lap].Inverse() * recording.truth[i];
    EXPECT_LT((around.t - truth.t).norm(), 0.3) << i;
  }
}

TEST_F(LoopsSessionTest, LeftWhileALostSensorIsLookedFor) {
  mapping_ = LapOptions();
  std::vector<SE3> truth = Laps(1.2, 110.0);
  const std::size_t dark = truth.size();
  const std::vector<SE3> elsewhere = LapsBack(1.0, 85.0, 35.0);
  truth.insert(truth.end(), elsewhere.begin(), elsewhere.end());
  const Recording recording = RecordTown(truth, 0.0, dark);
  SessionSetup whole = Setup("whole"), stopped = Setup("stopped");
  whole.session.checkpoint_every_scans = stopped.session.checkpoint_every_scans = 3;
  std::vector<PlaceReport> looks;
  {
    SessionHooks hooks;
    hooks.on_look = [&](const PlaceReport& report) { looks.push_back(report); };
    Session session(whole, hooks);
    Map(&session, recording, static_cast<std::int64_t>(recording.files.size()));
    EXPECT_EQ(session.mapping().counts().found, 1U);
  }
  const Result result = FinishSession(whole, recording);
  ASSERT_GE(looks.size(), 2U);
  ASSERT_TRUE(looks.back().found.has_value());
  // Before the first look, after one that is to be repeated, at the one that finds, and after.
  const auto first = static_cast<std::int64_t>(looks.front().scan);
  const auto found = static_cast<std::int64_t>(looks.back().scan);
  EXPECT_GT(first, static_cast<std::int64_t>(dark));
  for (const std::int64_t stop : {first - 4, first + 1, found, found + 1, found + 3, found + 8})
    MapUntil(stopped, recording, stop, stop % 2 == 0 ? Leave::kAtOnce : Leave::kWhenDone);
  ExpectSame(FinishSession(stopped, recording), result);
}

// A second recording is found in the map of the first, which then goes on as well.
TEST_F(LoopsSessionTest, LeftWhileARecordingRests) {
  mapping_ = LapOptions();
  mapping_.mapper.backend.final_after_frames = 40;
  std::vector<SE3> truth = Laps(1.2, 110.0);
  const std::size_t first = truth.size(), pause = first - 10;
  const std::vector<SE3> back = LapsBack(1.0, 95.0, 20.0);
  truth.insert(truth.end(), back.begin(), back.end());
  Recording recording = RecordTown(truth, 0.0, truth.size());
  for (std::size_t i = 0; i < truth.size(); ++i) {
    InboxFile& file = recording.files[i];
    file.sequence = i < first ? "there" : "back";
    file.name = file.sequence + "/" + file.name;
  }
  recording.files[first].next_stamp_ns = recording.files[first + 1].stamp_ns;
  // The last ten of the first come after those of the second.
  std::rotate(recording.files.begin() + static_cast<std::ptrdiff_t>(pause),
              recording.files.begin() + static_cast<std::ptrdiff_t>(first), recording.files.end());
  SessionSetup whole = Setup("whole"), stopped = Setup("stopped");
  whole.session.checkpoint_every_scans = stopped.session.checkpoint_every_scans = 3;
  std::int64_t begun = -1, found = -1;
  {
    SessionHooks hooks;
    hooks.on_look = [&](const PlaceReport& report) {
      if (begun < 0) begun = static_cast<std::int64_t>(report.scan);
      if (report.found) found = static_cast<std::int64_t>(report.scan);
    };
    Session session(whole, hooks);
    Map(&session, recording, static_cast<std::int64_t>(recording.files.size()));
    EXPECT_EQ(session.mapping().counts().found, 1U);
    EXPECT_EQ(session.mapping().counts().pieces, 3U);
  }
  const Result result = FinishSession(whole, recording);
  ASSERT_GT(found, begun);
  const auto woken = static_cast<std::int64_t>(pause + back.size());
  for (const std::int64_t stop :
       {begun - 12, begun - 4, begun + 1, found + 1, found + 4, woken + 1})
    MapUntil(stopped, recording, stop, stop % 2 == 0 ? Leave::kAtOnce : Leave::kWhenDone);
  ExpectSame(FinishSession(stopped, recording), result);
}

}  // namespace
}  // namespace lamina
