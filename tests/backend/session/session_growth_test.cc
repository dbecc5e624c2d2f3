// Sessions that go on and on: what is on disk follows what is alive, not what has been.
#include "tests/support/program/session_scenes.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

class SessionGrowthTest : public SessionTest {
 protected:
  // The same way there and back again and again, as one recording.
  Recording Laps(int laps, int scans, double reach_m) const {
    Scene scene;
    scene.scans = scans;
    scene.reach_m = reach_m;
    const Recording lap = Record(scene);
    Recording recording;
    for (int i = 0; i < laps * scans; ++i) {
      InboxFile file = lap.files[static_cast<std::size_t>(i % scans)];
      file.name = "scan" + std::to_string(10000 + i) + ".bin";
      file.stamp_ns = MadeUpStamp(static_cast<std::size_t>(i), {});
      file.next_stamp_ns = i == 0 ? std::optional(MadeUpStamp(1, {})) : std::nullopt;
      recording.files.push_back(file);
    }
    return recording;
  }
};

// The map's budget holds a part of the way: what is left behind goes to disk and comes back.
TEST_F(SessionGrowthTest, TheFileOfTheTilesIsAtMostTwiceWhatIsAliveLapAfterLap) {
  mapping_.mapper.map.budget_mb = 1.0;
  mapping_.mapper.map.depth = 2;
  constexpr int kLaps = 4, kScans = 80, kFirstWholeLap = 3, kStep = 5;
  constexpr std::int64_t kConstant = 1 << 20;
  const Recording recording = Laps(kLaps, kScans, 64.0);
  SessionSetup setup = Setup("session");
  setup.session.checkpoint_every_scans = 1000;
  Session session(setup, {});
  const std::string file = setup.folder + "/map_tiles.db";
  for (int scans = kStep; scans <= kLaps * kScans; scans += kStep) {
    Map(&session, recording, scans);
    session.WaitForHousekeeping();
    if (scans % (kScans / 4) != 0 || scans < kFirstWholeLap * kScans) continue;
    SCOPED_TRACE("after " + std::to_string(scans) + " scans");
    EXPECT_GT(session.stored_roots(), 500U);
    SQLite::Database tiles(file, SQLite::OPEN_READONLY);
    const std::int64_t live =
        tiles.execAndGet("SELECT SUM(length(record)) FROM voxels WHERE taken_at IS NULL")
            .getInt64();
    EXPECT_LT(static_cast<std::int64_t>(fs::file_size(file)), 2 * live + kConstant);
  }
}

}  // namespace
}  // namespace lamina
