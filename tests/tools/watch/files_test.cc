// What becomes of the files of an inbox: mapped, rejected, set aside, refused.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/resource.h>

#include <filesystem>
#include <string>

#include "tests/support/files/small_disk.h"
#include "tests/support/program/watch_scenes.h"
#include "tests/support/sanitizers.h"
#include "tools/watch/files.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

class WatchFilesTest : public WatchTest {
 protected:
  std::string Reason(const std::string& name) const {
    return Bytes(Path("session/rejected/" + name + ".reason.txt"));
  }
  // The reason of a file beside the stream comes a moment after it.
  testing::AssertionResult WaitForReason(pid_t daemon, const std::string& name,
                                         const std::string& reason) const {
    return WaitUntil(daemon, [&] { return Reason(name).find(reason) != std::string::npos; });
  }
};

TEST_F(WatchFilesTest, RejectedFilesLieBesideTheirReasons) {
  Recording street = Street(20);
  street[4].bytes.resize(999);
  street[9].bytes = std::string(16 * 500, '\xff');
  DropScans(street, 0, 20);
  Once();
  EXPECT_THAT(FilesIn("session/rejected"),
              ElementsAre("velodyne/000004.bin", "velodyne/000004.bin.reason.txt",
                          "velodyne/000009.bin", "velodyne/000009.bin.reason.txt"));
  EXPECT_TRUE(Bytes(Path("session/rejected/velodyne/000004.bin")) == street[4].bytes);
  EXPECT_THAT(Reason("velodyne/000004.bin"), HasSubstr("000004.bin"));
  EXPECT_NE(Reason("velodyne/000009.bin"), "");
  // Kept in the inbox, too.
  EXPECT_THAT(FilesIn("in"), SizeIs(21));
}

TEST_F(WatchFilesTest, DoneFilesGoWhenNothingNeedsThemAnyMore) {
  Recording street = Street(40);
  street[2].bytes.resize(999);
  const Arguments often{"--set", "session.checkpoint_every_scans=5", "--done", "move"};
  DropScans(street, 0, 40);
  Once(often);
  const auto done = FilesIn("session/done");
  EXPECT_THAT(done, testing::Contains("velodyne/000000.bin"));
  // What a damaged newest checkpoint would have to read again stays.
  EXPECT_THAT(done, testing::Not(testing::Contains("velodyne/000039.bin")));
  // A rejected one goes to its own place alone.
  EXPECT_THAT(done, testing::Not(testing::Contains("velodyne/000002.bin")));
  EXPECT_FALSE(fs::exists(Path("in/velodyne/000002.bin")));
  EXPECT_TRUE(Bytes(Path("session/rejected/velodyne/000002.bin")) == street[2].bytes);
  for (const std::string& name : done) EXPECT_FALSE(fs::exists(Path("in/" + name))) << name;
  EXPECT_EQ(done.size() + FilesIn("in").size(), 40U) << "39 scans and times.txt";
}

TEST_F(WatchFilesTest, ATruncatedFileIsTakenWhenItIsComplete) {
  const Recording street = Street(10);
  const pid_t daemon = StartWatch({"--set", "inbox.incomplete_wait_s=1000"});
  DropScans(street, 0, 3);
  ASSERT_TRUE(WaitForScans(daemon, 3));
  const std::string& bytes = street[3].bytes;
  const std::size_t half = bytes.size() / 32 * 16 + 7;
  std::ofstream(Path("in/times.txt"), std::ios::app) << fmt::format("{:.9f}\n", street[3].stamp_s);
  Drop("velodyne/000003.bin", bytes.substr(0, half));
  // Another sequence shows that the daemon has seen the truncated file, and goes on.
  DropScans(street, 4, 10);
  DropScans(street, 0, 2, "other/");
  ASSERT_TRUE(WaitForScans(daemon, 5));
  std::ofstream(Path("in/velodyne/000003.bin"), std::ios::app | std::ios::binary)
      << bytes.substr(half);
  ASSERT_TRUE(WaitForScans(daemon, 12));
  Terminate(daemon);
  EXPECT_EQ(Summary("session")["skipped_scans"], 0);
  const SessionDatabase database(Path("session/session.db"), true);
  std::vector<std::string> order;
  database.ForEach(4, 7, [&](const ScanRecord& scan) { order.push_back(scan.file); });
  EXPECT_THAT(order, ElementsAre("other/velodyne/000001.bin", "velodyne/000003.bin",
                                 "velodyne/000004.bin"));
}

TEST_F(WatchFilesTest, LateFilesAreSetAside) {
  const Recording street = Street(6);
  const pid_t daemon = StartWatch({"--set", "inbox.reorder_wait_s=0.01"});
  DropScans(street, 0, 3);
  ASSERT_TRUE(WaitForScans(daemon, 3));
  std::ofstream times(Path("in/times.txt"), std::ios::app);
  for (std::size_t i = 3; i < 6; ++i) times << fmt::format("{:.9f}\n", street[i].stamp_s);
  times.close();
  Drop("velodyne/000005.bin", street[5].bytes);
  ASSERT_TRUE(WaitForScans(daemon, 4));
  Drop("velodyne/000004.bin", street[4].bytes);
  ASSERT_TRUE(WaitForReason(daemon, "velodyne/000004.bin", "velodyne/000005.bin"));
  Terminate(daemon);
  EXPECT_EQ(Summary("session")["late_files"], 1);
  // It stays so.
  Once();
  EXPECT_EQ(Summary("session")["late_files"], 1);
  EXPECT_EQ(Summary("session")["frames"], 4);
}

TEST_F(WatchFilesTest, ANameIsTakenOnce) {
  const Recording street = Street(6);
  const pid_t daemon = StartWatch();
  DropScans(street, 0, 6);
  ASSERT_TRUE(WaitForScans(daemon, 6));
  Drop("velodyne/000002.bin", street[4].bytes);
  ASSERT_TRUE(WaitForReason(daemon, "velodyne/000002.bin", "taken before"));
  Terminate(daemon);
  EXPECT_EQ(Summary("session")["frames"], 6);
  Once();
  EXPECT_EQ(Summary("session")["frames"], 6);
}

TEST_F(WatchFilesTest, LinksOutOfTheInboxAreRefused) {
  const Recording street = Street(6);
  DropScans(street, 0, 4);
  Write("elsewhere/secret.bin", street[5].bytes);
  fs::create_symlink(Path("elsewhere/secret.bin"), Path("in/velodyne/000004.bin"));
  fs::create_directory_symlink(Path("elsewhere"), Path("in/linked"));
  fs::create_symlink("000099.bin", Path("in/velodyne/000099.bin"));
  std::ofstream(Path("in/times.txt"), std::ios::app) << "0.4\n0.5\n";
  const Outcome outcome = Once({"--done", "delete", "--set", "session.checkpoint_every_scans=1"});
  EXPECT_EQ(Summary("session")["frames"], 4);
  EXPECT_THAT(outcome.err, AllOf(HasSubstr("000004.bin: refused"), HasSubstr("linked: refused")));
  EXPECT_NE(Reason("velodyne/000004.bin"), "");
  EXPECT_TRUE(Bytes(Path("elsewhere/secret.bin")) == street[5].bytes);
  EXPECT_TRUE(fs::is_symlink(Path("in/velodyne/000004.bin")));
  // None of its bytes.
  EXPECT_THAT(FilesIn("session/rejected"), testing::Not(testing::Contains("velodyne/000004.bin")));
}

// A file whose name and content would retitle and recolour a terminal.
TEST_F(WatchFilesTest, HostileBytesAreShownAndHaveNoEffect) {
  const std::string name = "velodyne/\x1b]0;owned\x07.pcd";
  const std::string pcd =
      "# .PCD v.7\nVERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 1\nHEIGHT "
      "1\nPOINTS 1\nDATA ascii\n1 2 \x1b[31m7\x07\xff\n";
  Write("in/" + name, pcd);
  Write("one/1.pcd", pcd);
  const Outcome text = Once();
  const Outcome json = Once({"--set", "log.json=true"}, 0, "json");
  const Outcome run = Run(Path("one"), {}, 1);
  const std::string texts[] = {text.err,
                               json.err,
                               run.err,
                               Bytes(Path("session/log/lamina.log")),
                               Bytes(Path("json/log/lamina.log")),
                               Reason(name)};
  for (const std::string& shown : texts) {
    EXPECT_EQ(shown.find_first_of("\x1b\x07\r\xff"), std::string::npos) << shown;
    EXPECT_THAT(shown, HasSubstr("x1b[31m7"));
  }
  EXPECT_THAT(Bytes(Path("session/log/lamina.log")), HasSubstr("\\x1b]0;owned\\x07.pcd"));
}

// A session whose scans are the files 0.bin, 1.bin, ... of the inbox, the first of which was
// skipped.
class ReleasedFilesTest : public WatchTest {
 protected:
  static constexpr int kScans = 5;

  ReleasedFilesTest() {
    fs::remove_all(Path("in"));
    fs::create_directories(Path("in"));
    fs::create_directories(Path("session"));
  }
  static std::string Content(int scan) {
    return std::string(300000, static_cast<char>('a' + scan));
  }
  void MakeScans() {
    database_ = std::make_unique<SessionDatabase>(Path("session.db"), true);
    for (int i = 0; i < kScans; ++i) {
      ScanRecord scan;
      scan.scan = i;
      scan.file = std::to_string(i) + ".bin";
      scan.skipped = i == 0;
      scan.detail = "it is too short";
      Write("in/" + scan.file, Content(i));
      database_->Put(scan);
    }
  }
  WatchFiles Files(DonePolicy policy) const {
    return WatchFiles(Path("in"), Path("session"), policy);
  }
  // Each file is whole in one place at least, and in the one that it belongs to if it is not in the
  // inbox any more.
  void ExpectNothingIsLost(DonePolicy policy) const {
    for (int i = 0; i < kScans; ++i) {
      const std::string name = std::to_string(i) + ".bin";
      const std::string to = Path((i == 0 ? "session/rejected/" : "session/done/") + name);
      const bool here = fs::exists(Path("in/" + name));
      EXPECT_TRUE(!here || Bytes(Path("in/" + name)) == Content(i)) << name;
      if (!here && policy == DonePolicy::kDelete && i > 0) continue;
      EXPECT_TRUE((here && !fs::exists(to)) || Bytes(to) == Content(i)) << to;
    }
  }

  std::unique_ptr<SessionDatabase> database_;
};

// A recorder that counts from zero again, while nothing has been moved or deleted yet.
TEST_F(ReleasedFilesTest, AFileInThePlaceOfOneThatWasMappedIsKept) {
  for (const DonePolicy policy : {DonePolicy::kMove, DonePolicy::kDelete}) {
    MakeScans();
    const WatchFiles files = Files(policy);
    files.NoteReason("2.bin", "a file of this name was taken before");
    EXPECT_EQ(files.Release(*database_, 0, kScans), kScans);
    EXPECT_EQ(Bytes(Path("session/rejected/2.bin")), Content(2));
    for (int i = 0; i < kScans; ++i)
      EXPECT_FALSE(fs::exists(Path("in/" + std::to_string(i) + ".bin"))) << i;
    EXPECT_EQ(fs::exists(Path("session/done/3.bin")), policy == DonePolicy::kMove);
    fs::remove_all(Path("session"));
    fs::create_directories(Path("session"));
  }
}

TEST_F(ReleasedFilesTest, GoToAnotherFileSystemWhole) {
  const SmallDisk disk(Path("in"), 16 << 20);
  if (!disk.mounted()) GTEST_SKIP() << "only root can mount";
  MakeScans();
  // What copies that were cut short have left.
  Write("session/rejected/0.bin", Content(0).substr(0, 1000));
  Write("session/done/1.bin", Content(1).substr(0, 1000));
  Write("session/done/2.bin.partial", Content(2).substr(0, 1000));
  EXPECT_EQ(Files(DonePolicy::kMove).Release(*database_, 0, kScans), kScans);
  ExpectNothingIsLost(DonePolicy::kMove);
  EXPECT_THAT(FilesIn("in"), IsEmpty());
  EXPECT_THAT(FilesIn("session"), ElementsAre("done/1.bin", "done/2.bin", "done/3.bin",
                                              "done/4.bin", "rejected/0.bin"));
}

TEST_F(ReleasedFilesTest, StayWhereTheyAreWhileThereIsNoRoom) {
  const SmallDisk disk(Path("session"), 4096);
  if (!disk.mounted()) GTEST_SKIP() << "only root can mount";
  for (const DonePolicy policy : {DonePolicy::kMove, DonePolicy::kDelete}) {
    MakeScans();
    // From room for next to nothing to room for all: each of the copies is cut short once.
    std::int64_t next = 0;
    for (std::uint64_t room = 100000; room < 2000000; room += 100000) {
      ASSERT_TRUE(disk.Resize(room));
      next = Files(policy).Release(*database_, next, kScans);
      ExpectNothingIsLost(policy);
      for (const std::string& name : FilesIn("session")) {
        EXPECT_EQ(name.find(".partial"), std::string::npos) << name;
      }
    }
    EXPECT_EQ(next, kScans);
    EXPECT_THAT(FilesIn("in"), IsEmpty());
    fs::remove_all(Path("session/done"));
    fs::remove_all(Path("session/rejected"));
  }
}

TEST_F(WatchFilesTest, TwentyThousandFilesAtOnceEnd) {
  constexpr std::size_t kFiles = 20000;
  for (std::size_t i = 0; i < kFiles; ++i) {
    std::ofstream(Path("in/velodyne/" + ScanName(i))) << (i % 2 == 0 ? "0123456789abcdef" : "x");
  }
  const pid_t child = StartWatch({"--once", "--set", "log.rotate_mb=0.01", "--set",
                                  "log.kept_files=1", "--set", "log.json=true"});
  int status = 0;
  rusage usage{};
  ASSERT_EQ(wait4(child, &status, 0, &usage), child);
  // All of them are skipped: the verdict is wrong.
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 3)
      << Bytes(Path("stderr")).substr(0, 999);
  if (!kSanitized) {
    EXPECT_LT(usage.ru_maxrss, 150 * 1024) << "kB";
  }
  EXPECT_EQ(TimesMapped(Path("session/session.db")).size(), kFiles);
  EXPECT_EQ(Summary("session")["skipped_scans"], kFiles);
  EXPECT_THAT(FilesIn("session/rejected"), SizeIs(2 * kFiles));
  // Lines that are alike are counted, and the log is rotated: whole lines of JSON in each file.
  EXPECT_THAT(FilesIn("session/log"), ElementsAre("lamina.1.log", "lamina.log"));
  for (const std::string& name : FilesIn("session/log")) {
    const std::string text = Bytes(Path("session/log/" + name));
    EXPECT_LE(text.size(), 10486U);
    for (const std::string& line : Lines(text)) {
      const auto json = nlohmann::json::parse(line, nullptr, false);
      ASSERT_TRUE(json.contains("time") && json.contains("level") && json.contains("message"))
          << line;
    }
  }
}

}  // namespace
}  // namespace lamina
