// Sessions whose map is corrected by loops: left and continued around corrections.
#include <gtest/gtest.h>

#include "tests/support/drifting_drive.h"
#include "tests/support/session_scenes.h"

namespace lamina {
namespace {

class LoopsSessionTest : public SessionTest {
 protected:
  Recording RecordLap() const {
    const Town town(1, 90.0);
    Recording recording;
    recording.truth = Laps(1.2, 280.0);
    const std::vector<Scan> scans = CrookedScans(town, recording.truth, 0.01);
    for (std::size_t i = 0; i < scans.size(); ++i) {
      InboxFile file;
      file.name = "scan" + std::to_string(1000 + i) + ".bin";
      file.stamp_ns = MadeUpStamp(i, {});
      if (i == 0) file.next_stamp_ns = MadeUpStamp(1, {});
      file.path = Write("inbox/" + file.name, KittiBin(scans[i].points));
      recording.files.push_back(file);
    }
    return recording;
  }
};

TEST_F(LoopsSessionTest, LeftAroundCorrections) {
  mapping_ = LapOptions();
  const Recording recording = RecordLap();
  SessionSetup whole = Setup("whole"), stopped = Setup("stopped");
  whole.session.checkpoint_every_scans = stopped.session.checkpoint_every_scans = 3;
  const Result result = FinishSession(whole, recording);
  // Corrections are due so many scans after a submap of 20 m is complete: some stops fall between,
  // with the work under way.
  std::int64_t corrected = 0;
  for (const std::int64_t stop : {150, 194, 197, 199, 200, 201, 203, 205, 212, 219}) {
    MapUntil(stopped, recording, stop, stop % 2 == 0 ? Leave::kAtOnce : Leave::kWhenDone);
    Session session(stopped, {});
    corrected = std::max(corrected, session.mapping().loops()->corrections());
  }
  EXPECT_GT(corrected, 0);
  ExpectSame(FinishSession(stopped, recording), result);
  // What is published is corrected: the drift of a lap is gone from it.
  const Trajectory published = ReadTrajectory(Path("whole/trajectory_tum.txt"));
  ASSERT_EQ(published.size(), recording.truth.size());
  const std::size_t lap = 171, last = published.size() - 1;
  const SE3 around = published[last - lap].T_world_lidar.Inverse() * published[last].T_world_lidar;
  const SE3 truth = recording.truth[last - lap].Inverse() * recording.truth[last];
  EXPECT_LT((around.t - truth.t).norm(), 0.3);
}

}  // namespace
}  // namespace lamina
