// Sessions that go on and on: what is on disk follows what is alive, not what has been.
#include "tests/session_scenes.h"

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
TEST_F(SessionGrowthTest, TilesOnDiskStayAsManyAsAreAliveLapAfterLap) {
  mapping_.mapper.map.budget_mb = 1.0;
  mapping_.mapper.map.depth = 2;
  constexpr int kLaps = 6, kScans = 160, kFirstWholeLap = 3, kStep = 5;
  const Recording recording = Laps(kLaps, kScans, 64.0);
  SessionSetup setup = Setup("session");
  setup.session.checkpoint_every_scans = 1000;
  Session session(setup, {});
  const std::string file = setup.folder + "/map_tiles.db";
  std::uintmax_t first_bytes = 0;
  for (int scans = kStep; scans <= kLaps * kScans; scans += kStep) {
    Map(&session, recording, scans);
    session.WaitForHousekeeping();
    if (scans % kScans != 0 || scans < kFirstWholeLap * kScans) continue;
    SCOPED_TRACE("lap " + std::to_string(scans / kScans));
    SQLite::Database tiles(file, SQLite::OPEN_READONLY);
    const auto rows = tiles.execAndGet("SELECT COUNT(*) FROM voxels").getInt64();
    const auto live = static_cast<std::int64_t>(session.stored_roots());
    EXPECT_GT(live, 700);
    EXPECT_LT(rows, 2 * live);
    if (first_bytes == 0) first_bytes = fs::file_size(file);
    EXPECT_LT(fs::file_size(file), first_bytes + first_bytes / 4);
  }
}

}  // namespace
}  // namespace lamina
