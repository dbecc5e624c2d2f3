// `lamina watch` maps as `lamina run` does, however the files come.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <random>
#include <string>
#include <vector>

#include "tests/support/program/watch_scenes.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::SizeIs;

class WatchCommandTest : public WatchTest {
 protected:
  // A drive with scans that cannot be used: cut off, empty, of nonsense, from the past.
  static Recording FaultyStreet() {
    Recording street = Street(34);
    street[5].bytes.resize(1001);
    street[11].bytes.clear();
    street[17].bytes = std::string(16 * 500, '\xff');
    street[23].stamp_s = street[20].stamp_s;
    return street;
  }
};

TEST_F(WatchCommandTest, OnceLeavesWhatRunLeaves) {
  WriteRecording("in", FaultyStreet());
  Run(Path("in"), {"--threads", "1"});
  EXPECT_EQ(Summary()["skipped_scans"], 4);
  for (const char* threads : {"1", "2"}) {
    const std::string session = std::string("session-") + threads;
    const Outcome outcome = Once({"--threads", threads}, 0, session);
    EXPECT_THAT(outcome.out, HasSubstr(session + "/map_surfels.ply"));
    ExpectSameResults(session, "out");
    for (const char* figure :
         {"frames", "keyframes", "skipped_by_reason", "map_voxels", "map_nodes", "map_leaves",
          "map_surfels", "ba_solves", "lost_frames"}) {
      EXPECT_EQ(Summary(session)[figure], Summary()[figure]) << figure;
    }
  }
}

TEST_F(WatchCommandTest, AFolderOfStampedNamesGivesWhatRunGives) {
  const Recording street = Street(12);
  fs::remove(Path("in/velodyne"));
  for (std::size_t i = 0; i < street.size(); ++i) {
    const auto ns = 1'600'000'000'000'000'000 + static_cast<std::int64_t>(1e9 * street[i].stamp_s);
    Write("in/" + std::to_string(ns) + ".bin", street[i].bytes);
  }
  Run(Path("in"));
  Once();
  ExpectSameResults("session", "out");
}

TEST_F(WatchCommandTest, ASmallBudgetChangesNothing) {
  ASSERT_EQ(Lamina({"synth", "--out", Path("in"), "--sensor", "vlp16", "--frames", "100", "--route",
                    "straight"})
                .code,
            0);
  const Arguments budget{"--set", "map.budget_mb=2.8"};
  Run(Path("in"), budget);
  Once({"--set", "map.budget_mb=2.8", "--set", "session.checkpoint_every_scans=30"});
  ExpectSameResults("session", "out");
  EXPECT_GT(Summary("session")["stored_voxels"], 0);
  EXPECT_LE(Summary("session")["map_peak_bytes"], 2.8 * 1048576);
}

TEST_F(WatchCommandTest, FilesThatComeOneByOneGiveTheSame) {
  const Recording street = FaultyStreet();
  // Times for an incomplete file to be given up as one.
  const pid_t daemon = StartWatch({"--set", "inbox.incomplete_wait_s=0.3"});
  const unsigned seed = std::random_device{}();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  // The first waits for the second, as the sweep's period is taken from the two.
  DropScans(street, 0, 2);
  for (std::size_t there = 2; there < street.size();) {
    ASSERT_TRUE(WaitForScans(daemon, static_cast<std::int64_t>(there)));
    const std::size_t next = std::min(street.size(), there + 1 + random() % 6);
    DropScans(street, there, next);
    there = next;
  }
  ASSERT_TRUE(WaitForScans(daemon, static_cast<std::int64_t>(street.size())));
  Terminate(daemon);
  Run(Path("in"));
  ExpectSameResults("session", "out");
}

TEST_F(WatchCommandTest, WhatComesLaterContinuesAFinishedSession) {
  const Recording street = Street(30);
  DropScans(street, 0, 13);
  Once();
  EXPECT_THAT(Lines(Bytes(Path("session/trajectory_kitti.txt"))), SizeIs(13));
  // Nothing new: nothing changes.
  const std::string before = Bytes(Path("session/trajectory_kitti.txt"));
  const std::string map = Bytes(Path("session/map_surfels.ply"));
  Once();
  EXPECT_TRUE(Bytes(Path("session/trajectory_kitti.txt")) == before);
  EXPECT_TRUE(Bytes(Path("session/map_surfels.ply")) == map);
  DropScans(street, 13, 30);
  Once();
  Run(Path("in"));
  ExpectSameResults("session", "out");
}

TEST_F(WatchCommandTest, SequencesInSubfoldersFollowEachOther) {
  const Recording street = Street(36);
  const Recording first(street.begin(), street.begin() + 18),
      second(street.begin() + 18, street.end());
  WriteRecording("in/drive 1", first);
  WriteRecording("in/drive 2", second);
  Once();
  const auto mapped = TimesMapped(Path("session/session.db"));
  EXPECT_EQ(mapped.size(), 36U);
  EXPECT_EQ(mapped.count("drive 2/velodyne/000017.bin"), 1U);
  EXPECT_EQ(Summary("session")["lost_frames"], 0);
  // The same when the second comes to a daemon that has the first.
  fs::rename(Path("in/drive 2"), Path("later"));
  const pid_t daemon = StartWatch({}, "again");
  ASSERT_TRUE(WaitForScans(daemon, 18, "again"));
  fs::rename(Path("later"), Path("in/drive 2"));
  ASSERT_TRUE(WaitForScans(daemon, 36, "again"));
  Terminate(daemon);
  ExpectSameResults("again", "session");
  // Alone, the first is as `run` has it.
  fs::remove_all(Path("in/drive 2"));
  Once({}, 0, "alone");
  Run(Path("in/drive 1"));
  ExpectSameResults("alone", "out");
}

TEST_F(WatchCommandTest, NamesOfAnyBytesAreNames) {
  const Recording street = Street(8);
  const std::vector<std::string> folders{"two words", "zwei\nZeilen",
                                         "Stra\xc3\x9f"
                                         "e \xe5\x9b\xb3",
                                         "no utf-8 \xff\xfe"};
  for (const std::string& folder : folders) {
    for (std::size_t i = 0; i < street.size(); ++i) {
      Write("in/" + folder + "/scan " + folder + std::to_string(i) + ".bin", street[i].bytes);
    }
  }
  Once({"--set", "log.json=true"});
  const auto mapped = TimesMapped(Path("session/session.db"));
  EXPECT_EQ(mapped.size(), 32U);
  for (const std::string& folder : folders) {
    const auto found = mapped.find(folder + "/scan " + folder + "7.bin");
    ASSERT_NE(found, mapped.end()) << folder;
    EXPECT_EQ(found->second, 1);
  }
  Once({"--done", "move"});
  EXPECT_EQ(FilesIn("in").size() + FilesIn("session/done").size(), 32U);
}

TEST_F(WatchCommandTest, ClocksOfFilesDoNotMatter) {
  const Recording street = Street(10);
  DropScans(street, 0, 10);
  const auto now = fs::file_time_type::clock::now();
  for (int i = 0; i < 10; ++i) {
    const auto years = std::chrono::hours(24 * 365 * (i % 2 == 0 ? 20 : -40));
    fs::last_write_time(Path("in/velodyne/" + ScanName(static_cast<std::size_t>(i))), now + years);
  }
  for (const char* watch : {"inotify", "poll"}) {
    fs::remove_all(Path("session"));
    const pid_t daemon = StartWatch({"--set", std::string("inbox.watch=") + watch, "--set",
                                     "inbox.settle_s=0.05", "--set", "inbox.poll_period_s=0.02"});
    ASSERT_TRUE(WaitForScans(daemon, 10)) << watch;
    Terminate(daemon);
    if (!fs::exists(Path("out"))) Run(Path("in"));
    ExpectSameResults("session", "out");
  }
}

TEST_F(WatchCommandTest, BadCommandLinesAreRefused) {
  const auto refused = [&](const Arguments& more, const std::string& why) {
    const Outcome outcome = Once(more, 2);
    EXPECT_THAT(outcome.err + outcome.out, HasSubstr(why));
  };
  refused({"--done", "burn"}, "--done");
  refused({"--mode", "dream"}, "--mode");
  refused({"--mode", "localise"}, "needs --map");
  refused({"--map", Path("other")}, "--mode localise");
  refused({"--start", "1", "2", "3"}, "--mode localise");
  refused({"--mode", "localise", "--map", "m", "--start", "1", "2", "3", "4"}, "4 numbers");
  refused({"--mode", "localise", "--map", "m", "--start", "0", "0", "0", "2", "0", "0", "0"},
          "norm 2");
  refused({"--http", "nonsense"}, "nonsense");
  refused({"--set", "session.checkpoint_every_scans=0"}, "session.checkpoint_every_scans");
  refused({"--set", "no.such=1"}, "no.such");
  refused({"--unknown"}, "--unknown");
  EXPECT_EQ(Lamina({"watch", "--session", Path("s")}).code, 2);
  EXPECT_EQ(Lamina({"watch", "--inbox", Path("in")}).code, 2);
  EXPECT_THAT(FilesIn("session"), testing::Not(testing::Contains("session.db")));
}

TEST_F(WatchCommandTest, FoldersThatCannotWorkAreRefused) {
  const auto fails = [&](const std::string& inbox, const std::string& session, int code,
                         const std::string& why) {
    const Outcome outcome =
        Lamina({"watch", "--once", "--http", "off", "--inbox", inbox, "--session", session});
    EXPECT_EQ(outcome.code, code) << outcome.err;
    EXPECT_THAT(outcome.err, AllOf(HasSubstr("lamina: error: "), HasSubstr(why)));
  };
  fails(Path("missing"), Path("s"), 1, "must be a folder");
  Write("file", "x");
  fails(Path("file"), Path("s"), 1, "must be a folder");
  fails(Path("in"), Path("file"), 1, "file");
  // What a session moves or rejects must not come back as new.
  fails(Path("in"), Path("in/session"), 2, "outside of the inbox");
  fails(Path("in"), Path("in"), 2, "outside of the inbox");
  fs::create_directory_symlink(Path("in"), Path("link"));
  fails(Path("in"), Path("link/session"), 2, "outside of the inbox");
}

TEST_F(WatchCommandTest, OnceItEndsAsRunDoesWherePosesAreProbablyWrong) {
  DropScans(Street(6), 0, 6);
  for (int i = 6; i < 16; ++i) Write(fmt::format("in/{:06}.bin", i), "no scan");
  Once({}, 3);
}

TEST_F(WatchCommandTest, OtherOptionsAreRefusedOnContinuing) {
  DropScans(Street(6), 0, 6);
  Once();
  const std::string before = Bytes(Path("session/trajectory_kitti.txt"));
  const Outcome outcome = Once({"--set", "backend.window.frames=9"}, 2);
  EXPECT_THAT(outcome.err, AllOf(HasSubstr("frames: 15"), HasSubstr("frames: 9")));
  EXPECT_TRUE(Bytes(Path("session/trajectory_kitti.txt")) == before);
  // Those that do not decide results may differ.
  Once({"--set", "session.checkpoint_every_scans=3", "--set", "log.level=debug", "--set",
        "inbox.reorder_wait_s=1"});
}

}  // namespace
}  // namespace lamina
