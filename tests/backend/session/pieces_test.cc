// Recordings and pieces of the map: what is not connected is kept apart, and scans of several
// recordings may alternate.
#include <gmock/gmock.h>

#include "tests/support/program/session_scenes.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;

class PiecesTest : public SessionTest {
 protected:
  PiecesTest() { mapping_.mapper.backend.restart_after_lost_frames = 3; }

  // A recording of its own, in a corridor of its own.
  Recording Named(const std::string& name, int scans, double reach_m, unsigned seed = 1) const {
    Scene scene;
    scene.scans = scans;
    scene.reach_m = reach_m;
    scene.seed = seed;
    Recording recording = Record(scene, "inbox/" + name);
    for (InboxFile& file : recording.files) {
      file.sequence = name;
      file.name = name + "/" + file.name;
    }
    return recording;
  }
  // Scans of several recordings in turns, `run` of one before the next one's.
  static Recording Alternating(const std::vector<Recording>& of, std::size_t run = 1) {
    Recording all;
    std::vector<std::size_t> next(of.size(), 0);
    for (bool any = true; any;) {
      any = false;
      for (std::size_t r = 0; r < of.size(); ++r) {
        for (std::size_t k = 0; k < run && next[r] < of[r].files.size(); ++k, ++next[r]) {
          all.files.push_back(of[r].files[next[r]]);
          all.truth.push_back(of[r].truth[next[r]]);
          any = true;
        }
      }
    }
    return all;
  }

  struct Mapped {
    std::vector<ScanRecord> rows;
    std::vector<FinalPose> poses;
    std::map<std::int64_t, std::multiset<std::string>> map;  // surfels by piece
    MappingCounts counts;
  };
  Mapped MapAll(const Recording& recording, const std::string& folder) const {
    fs::remove_all(Path(folder));
    Mapped mapped;
    SessionHooks hooks;
    hooks.on_scan = [&](const MappedScan&, const ScanRecord& row) { mapped.rows.push_back(row); };
    Session session(Setup(folder), hooks);
    Map(&session, recording, static_cast<std::int64_t>(recording.files.size()));
    session.Finish();
    session.ForEachPose([&](const FinalPose& pose) { mapped.poses.push_back(pose); });
    session.mapping().map().ForEachSurface(1, [&](Surfel s) {
      StateArchive a;
      a(&s.centre, &s.normal, &s.eigenvalues, &s.count);
      mapped.map[s.piece].insert(a.written());
    });
    mapped.counts = session.mapping().counts();
    return mapped;
  }
  // Poses and surfels of one piece, to the last bit.
  static std::string PosesOf(const Mapped& mapped, std::int64_t piece) {
    StateArchive a;
    for (FinalPose pose : mapped.poses) {
      if (pose.piece == piece) a(&pose.pose);
    }
    return a.written();
  }
  static double WorstError(const Mapped& mapped, const Recording& recording, std::int64_t piece) {
    double worst = 0.0;
    const SE3* first = nullptr;
    const SE3* first_true = nullptr;
    for (std::size_t i = 0; i < mapped.poses.size(); ++i) {
      if (mapped.poses[i].piece != piece || mapped.rows[i].status == "lost") continue;
      if (first == nullptr) {
        first = &mapped.poses[i].pose.T_world_lidar;
        first_true = &recording.truth[i];
      }
      const SE3 is = first->Inverse() * mapped.poses[i].pose.T_world_lidar;
      const SE3 should = first_true->Inverse() * recording.truth[i];
      worst = std::max(worst, (is.t - should.t).norm());
    }
    return worst;
  }
};

TEST_F(PiecesTest, AlternatingRecordingsGiveWhatEachGivesAlone) {
  const std::vector<Recording> alone = {Named("a", 24, 4.0), Named("b", 26, 5.0, 2),
                                        Named("c", 18, 3.0, 3)};
  std::vector<Mapped> singles;
  for (const Recording& recording : alone) singles.push_back(MapAll(recording, "single"));
  for (const std::size_t run : {1U, 3U, 100U}) {
    SCOPED_TRACE(run);
    const Recording all = Alternating(alone, run);
    const Mapped together = MapAll(all, "together");
    EXPECT_EQ(together.counts.pieces, alone.size());
    EXPECT_EQ(together.counts.lost, 0U);
    ASSERT_EQ(together.poses.size(), all.files.size());
    for (std::size_t r = 0; r < alone.size(); ++r) {
      const Mapped& single = singles[r];
      const auto piece = static_cast<std::int64_t>(r);
      EXPECT_TRUE(PosesOf(together, piece) == PosesOf(single, 0)) << "poses of " << r;
      EXPECT_TRUE(together.map.at(piece) == single.map.at(0)) << "map of " << r;
      EXPECT_LT(WorstError(together, all, piece), 0.05);
    }
    for (std::size_t i = 0; i < all.files.size(); ++i) {
      EXPECT_EQ(together.rows[i].piece, all.files[i].sequence[0] - 'a');
      EXPECT_EQ(together.poses[i].piece, together.rows[i].piece);
      EXPECT_EQ(together.poses[i].scan, i);
    }
  }
}

TEST_F(PiecesTest, AlternatingRecordingsAreContinuedAfterAnyScan) {
  const Recording all =
      Alternating({Named("a", 13, 4.0), Named("b", 11, 6.0, 2), Named("c", 9, 5.0, 3)}, 2);
  // Two: one of them is always ended for another.
  for (const int most : {3, 2}) {
    mapping_.pipeline.max_recordings = most;
    fs::remove_all(Path("whole"));
    const Result whole = FinishSession(Setup("whole"), all);
    for (int stop = 4; stop < 33; stop += most == 2 ? 7 : 11) {
      SCOPED_TRACE(std::to_string(most) + " at once, left after " + std::to_string(stop));
      const SessionSetup setup = Setup("stopped");
      fs::remove_all(setup.folder);
      MapUntil(setup, all, stop, stop % 2 == 0 ? Leave::kAtOnce : Leave::kWhenDone);
      ExpectSame(FinishSession(setup, all), whole);
      if (HasFailure()) return;
    }
  }
}

// Once a checkpoint takes longer than the next one is due, the disk decides when it is made.
TEST_F(PiecesTest, WhenCheckpointsAreMadeChangesNothing) {
  const Recording all =
      Alternating({Named("a", 13, 4.0), Named("b", 11, 6.0, 2), Named("c", 9, 5.0, 3)}, 2);
  SessionSetup setup = Setup("rarely");
  setup.session.checkpoint_every_scans = 1000;
  const Result rarely = FinishSession(setup, all);
  for (int stop = 2; stop < 33; stop += 7) {
    SCOPED_TRACE("left after " + std::to_string(stop));
    setup = Setup("stopped");
    fs::remove_all(setup.folder);
    setup.session.checkpoint_every_scans = 1 + stop % 3;
    MapUntil(setup, all, stop, Leave::kWhenDone);
    setup.session.checkpoint_every_scans = stop % 4 == 0 ? 1000 : 7;
    ExpectSame(FinishSession(setup, all), rarely);
  }
}

// The sensor is carried off in the middle: to another corridor, seen from the same place in it.
TEST_F(PiecesTest, ARestartAfterLossBeginsAPieceThatIsNotConnected) {
  Recording all = Named("a", 15, 4.0);
  const Corridor elsewhere(40.0);
  const SE3 carried(ExpSO3({0.0, 0.0, M_PI / 2.0}), {18.0, 0.0, 0.0});
  for (int i = 0; i < 15; ++i) {
    InboxFile file = all.files.back();
    file.name = "a/z" + std::to_string(100 + i) + ".bin";
    file.stamp_ns += 100000000;
    all.truth.push_back(SE3(Eigen::Quaterniond::Identity(), {14.0 + 0.1 * i, 0.0, 0.0}));
    // Neither what it sees nor where it looks fits what was mapped before.
    file.path = Write("inbox/" + file.name,
                      elsewhere.Scan(all.truth.back() * SE3(carried.q, {0, 0, 0}), 900U + i));
    all.truth.back() = all.truth.back() * SE3(carried.q, {0, 0, 0});
    all.files.push_back(file);
  }
  const Mapped mapped = MapAll(all, "session");
  ASSERT_EQ(mapped.rows.size(), 30U);
  EXPECT_EQ(mapped.counts.restarts, 1U);
  EXPECT_EQ(mapped.counts.pieces, 2U);
  for (std::size_t i = 0; i < 30; ++i) {
    SCOPED_TRACE(i);
    const std::string expected = i == 0 || i == 18   ? "first"
                                 : i >= 15 && i < 18 ? "lost"
                                                     : "tracked";
    EXPECT_EQ(mapped.rows[i].status == "degenerate" ? "tracked" : mapped.rows[i].status, expected);
    EXPECT_EQ(mapped.rows[i].piece, i < 18 ? 0 : 1);
  }
  EXPECT_LT(WorstError(mapped, all, 0), 0.05);
  EXPECT_LT(WorstError(mapped, all, 1), 0.05);
  // The map of the first is what it was: nothing of the second is drawn over it.
  Recording first = all;
  first.files.resize(15);
  const Mapped alone = MapAll(first, "alone");
  EXPECT_NEAR(double(mapped.map.at(0).size()), double(alone.map.at(0).size()), 5.0);
  EXPECT_GT(mapped.map.at(1).size(), 20U);
}

TEST_F(PiecesTest, TheRecordingSilentLongestIsEndedForANewOne) {
  mapping_.pipeline.max_recordings = 2;
  const std::vector<Recording> of = {Named("a", 60, 4.0), Named("b", 60, 5.0, 2),
                                     Named("c", 60, 6.0, 3)};
  // a and b in turns, then c: a has been silent for longer. Then b goes on, and a begins anew.
  Recording all;
  const auto take = [&](std::size_t r, std::size_t i) {
    all.files.push_back(of[r].files[i]);
    all.truth.push_back(of[r].truth[i]);
  };
  for (std::size_t i = 0; i < 4; ++i) take(0, i), take(1, i);
  for (std::size_t i = 0; i < 4; ++i) take(2, i);
  take(1, 4);
  take(0, 4);
  take(0, 5);
  const Mapped mapped = MapAll(all, "session");
  std::vector<std::int64_t> pieces;
  for (const ScanRecord& row : mapped.rows) pieces.push_back(row.piece);
  EXPECT_THAT(pieces, ElementsAre(0, 1, 0, 1, 0, 1, 0, 1, 2, 2, 2, 2, 1, 3, 3));
  EXPECT_EQ(mapped.counts.pieces, 4U);
  for (std::int64_t piece = 0; piece < 4; ++piece) EXPECT_LT(WorstError(mapped, all, piece), 0.05);
}

// More recordings in turns than are mapped at once: no scan ever meets the one before it.
TEST_F(PiecesTest, PiecesInWhichNothingWasMatchedLeaveNothingInTheMap) {
  mapping_.pipeline.max_recordings = 1;
  const Recording all = Alternating({Named("a", 12, 4.0), Named("b", 12, 6.0, 2)});
  const Mapped mapped = MapAll(all, "session");
  EXPECT_EQ(mapped.counts.pieces, 24U);
  EXPECT_EQ(mapped.poses.size(), 24U);
  ASSERT_EQ(mapped.map.size(), 1U);
  EXPECT_EQ(mapped.map.begin()->first, 23);
}

TEST_F(PiecesTest, ASilentRecordingDoesNotHoldUpThePosesOfOthers) {
  mapping_.mapper.backend.final_after_frames = 10;
  Recording all = Named("a", 6, 4.0);
  const Recording b = Named("b", 40, 6.0, 2);
  all.files.insert(all.files.end(), b.files.begin(), b.files.end());
  std::int64_t final = 0, mapped = 0;
  SessionHooks hooks;
  hooks.on_final = [&](const FinalPose& pose) {
    EXPECT_EQ(static_cast<std::int64_t>(pose.scan), final++);
  };
  hooks.on_scan = [&](const MappedScan&, const ScanRecord&) { ++mapped; };
  Session session(Setup("session"), hooks);
  for (std::int64_t end = 1; end <= 46; ++end) {
    Map(&session, all, end);
    EXPECT_GE(final, mapped - 10);
  }
}

TEST_F(PiecesTest, UnreadableScansWithoutEndDoNotPileUp) {
  mapping_.mapper.backend.final_after_frames = 10;
  Scene scene;
  scene.scans = 40;
  for (int i = 3; i < 40; ++i) scene.unreadable.insert(i);
  const Recording recording = Record(scene);
  std::int64_t final = 0;
  SessionHooks hooks;
  hooks.on_final = [&](const FinalPose&) { ++final; };
  Session session(Setup("session"), hooks);
  Map(&session, recording, 40);
  EXPECT_EQ(final, 30);
}

}  // namespace
}  // namespace lamina
