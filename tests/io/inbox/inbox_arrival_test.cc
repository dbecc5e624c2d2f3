// The inbox by how things get there: complete and incomplete files, folders, links, both watchers.
#include <signal.h>
#include <sys/stat.h>
#include <sys/time.h>
#include <unistd.h>

#include <cmath>
#include <thread>

#include "io/inbox/name_set.h"
#include "io/points/scan_file.h"
#include "tests/support/files/inbox_scenes.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::UnorderedElementsAre;

class InboxArrivalTest : public InboxScene,
                         public testing::WithParamInterface<InboxOptions::Watch> {
 protected:
  InboxArrivalTest() { options_.watch = GetParam(); }
  bool Polls() const { return GetParam() == InboxOptions::Watch::kPoll; }
  // What makes a file that was dropped whole complete for either watcher: two looks, settle_s
  // apart. A file that is found incomplete stays so.
  void Settle() {
    for (int i = 0; i < 4; ++i) Pass(0.51);
    inbox_->Wait(std::chrono::seconds(0));
  }
};

std::string BinaryPcd(int points) {
  std::string bytes =
      "VERSION .7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\nWIDTH 2\nHEIGHT 1\n"
      "POINTS 2\nDATA binary\n";
  for (int i = 0; i < points; ++i) bytes += Pack(1.0F, 2.0F, 3.0F);
  return bytes;
}

std::string BinaryPly(int points) {
  std::string bytes =
      "ply\nformat binary_little_endian 1.0\nelement vertex 2\nproperty float x\n"
      "property float y\nproperty float z\nend_header\n";
  for (int i = 0; i < points; ++i) bytes += Pack(1.0F, 2.0F, 3.0F);
  return bytes;
}

TEST_P(InboxArrivalTest, FilesThatWereThereAndFilesThatCome) {
  DropOld("a/1.bin");
  DropOld("a/2.bin");
  Open();
  Settle();
  EXPECT_THAT(Take(), ElementsAre("a/1.bin", "a/2.bin"));
  Drop("a/3.bin");
  Write("in/.hidden.bin", OnePoint());
  Write("in/.hidden/1.bin", OnePoint());
  Write("in/a/4.bin.partial", OnePoint());
  Write("in/a/5.tmp", OnePoint());
  Write("in/a/6.bin.part", OnePoint());
  Write("in/a/notes.txt", "text");
  Settle();
  EXPECT_THAT(Take(), ElementsAre("a/3.bin"));
  fs::rename(In("a/4.bin.partial"), In("a/4.bin"));
  Settle();
  EXPECT_THAT(Take(), ElementsAre("a/4.bin"));
  EXPECT_EQ(inbox_->waiting(), 0U);
  EXPECT_EQ(inbox_->polls().empty(), !Polls());
}

TEST_P(InboxArrivalTest, FilesThatAreStillWrittenHoldUpTheSequence) {
  Open();
  std::ofstream growing(In("1.bin"), std::ios::binary);
  growing << OnePoint() << std::flush;
  Drop("2.bin");
  Drop("3.bin");
  for (int i = 0; i < 5; ++i) {
    Pass(0.6);
    inbox_->Wait(std::chrono::seconds(0));
    growing << OnePoint() << std::flush;
    // Times of change have a grain of some milliseconds; the size differs in any case.
    EXPECT_THAT(Take(), IsEmpty()) << i;
  }
  growing.close();
  Settle();
  EXPECT_THAT(Take(), ElementsAre("1.bin", "2.bin", "3.bin"));
  EXPECT_EQ(fs::file_size(In("1.bin")), 6 * 16U);
}

TEST_P(InboxArrivalTest, TruncatedFilesAreTakenWhenCompleted) {
  const std::string pcd = BinaryPcd(2), ply = BinaryPly(2), bin = OnePoint() + OnePoint();
  Open();
  Write("in/1.pcd", pcd.substr(0, pcd.size() - 1));
  Write("in/2.pcd", pcd.substr(0, 70));  // within the header
  Write("in/3.ply", ply.substr(0, ply.size() - 1));
  Write("in/4.bin", bin.substr(0, 20));
  Write("in/5.bin", "");
  Settle();
  EXPECT_THAT(Take(), IsEmpty());
  EXPECT_EQ(inbox_->waiting(), 5U);
  Write("in/1.pcd", pcd);
  Settle();
  Write("in/2.pcd", pcd);
  Settle();
  EXPECT_THAT(Take(), ElementsAre("1.pcd", "2.pcd"));
  Write("in/3.ply", ply);
  Write("in/4.bin", bin);
  Write("in/5.bin", bin);
  Settle();
  EXPECT_THAT(Take(), ElementsAre("3.ply", "4.bin", "5.bin"));
  EXPECT_NO_THROW(ReadScanFile(In("1.pcd"), scans_.point_time_unit));
  EXPECT_NO_THROW(ReadScanFile(In("3.ply"), scans_.point_time_unit));
}

TEST_P(InboxArrivalTest, EndingsInAnyCase) {
  const std::string pcd = BinaryPcd(2);
  Open();
  Write("in/1.BIN", OnePoint());
  Write("in/2.Pcd", pcd.substr(0, pcd.size() - 1));
  Write("in/3.bin", OnePoint());
  Settle();
  EXPECT_THAT(Take(), IsEmpty());
  EXPECT_EQ(inbox_->waiting(), 3U);
  Write("in/2.Pcd", pcd);
  Settle();
  EXPECT_THAT(Take(), ElementsAre("1.BIN", "2.Pcd", "3.bin"));
}

TEST_P(InboxArrivalTest, WhatStaysIncompleteIsHandedOutInTheEnd) {
  Write("in/0.pcd", "VERSION .7\nFIELDS x y z\n");
  Write("in/1.pcd", BinaryPcd(1));
  Write("in/2.bin", "12345");
  DropOld("3.bin");
  Open();
  for (int i = 0; i < 15; ++i) Pass(0.6);
  EXPECT_THAT(Take(), IsEmpty());
  for (int i = 0; i < 4; ++i) Pass(0.6);
  EXPECT_THAT(Take(), ElementsAre("0.pcd", "1.pcd", "2.bin", "3.bin"));
  EXPECT_THROW(ReadScanFile(In("1.pcd"), scans_.point_time_unit), InputError);
}

TEST_P(InboxArrivalTest, ABrokenHeaderIsForTheReaderToReject) {
  Write("in/0.pcd", "VERSION .7\nnonsense\n");
  Write("in/1.ply", "not ply\n");
  Open();
  Age("0.pcd");
  Settle();
  EXPECT_THAT(Take(), ElementsAre("0.pcd", "1.ply"));
}

TEST_P(InboxArrivalTest, FilesFromTheFutureAreTaken) {
  Drop("1.bin");
  Drop("2.bin");
  const auto future = fs::file_time_type::clock::now() + std::chrono::hours(1000);
  for (const char* name : {"1.bin", "2.bin"}) fs::last_write_time(In(name), future);
  Open();
  Settle();
  EXPECT_THAT(Take(), ElementsAre("1.bin", "2.bin"));
}

TEST_P(InboxArrivalTest, DeletedFilesAndFoldersAreForgotten) {
  for (const char* name : {"a/1.bin", "a/2.bin", "b/1.bin", "b/2.bin", "b-2/1.bin", "c/d/1.bin"}) {
    DropOld(name);
  }
  Open();
  inbox_->Wait(std::chrono::seconds(0));
  EXPECT_EQ(inbox_->waiting(), 6U);
  fs::remove(In("a/1.bin"));
  fs::remove_all(In("b"));
  fs::rename(In("c"), Path("elsewhere"));
  Settle();
  EXPECT_EQ(inbox_->waiting(), 2U);
  // A folder that went is no longer watched; one that comes is.
  Write("elsewhere/d/2.bin", OnePoint());
  fs::rename(Path("elsewhere"), In("e"));
  Settle();
  EXPECT_EQ(inbox_->waiting(), 4U);
  inbox_->Drain();
  EXPECT_THAT(Take(), ElementsAre("a/2.bin", "b-2/1.bin", "e/d/1.bin", "e/d/2.bin"));
}

TEST_P(InboxArrivalTest, FoldersBelowFoldersAreWatchedWithWhatIsInThem) {
  Open();
  DropOld("a/b/c/1.bin");
  DropOld("a/b/c/2.bin");
  Settle();
  EXPECT_THAT(Take(), ElementsAre("a/b/c/1.bin", "a/b/c/2.bin"));
  Drop("a/b/c/3.bin");
  Settle();
  EXPECT_THAT(Take(), ElementsAre("a/b/c/3.bin"));
}

TEST_P(InboxArrivalTest, LinksWithinTheInboxAreFilesAndOthersAreRefused) {
  DropOld("a/1.bin");
  Write("outside/1.bin", OnePoint());
  fs::create_directories(In("links"));
  Open();
  fs::create_symlink("../a/1.bin", In("links/1.bin"));
  fs::create_hard_link(In("a/1.bin"), In("links/2.bin"));
  fs::create_symlink(Path("outside/1.bin"), In("links/out.bin"));
  fs::create_symlink(Path("outside"), In("links/folder"));
  fs::create_symlink(Path("outside"), In("links/folder.bin"));
  fs::create_symlink(In("a"), In("links/inside"));
  fs::create_symlink("..", In("links/up"));
  fs::create_symlink("loop.bin", In("links/loop.bin"));
  fs::create_symlink("nothing.bin", In("links/dangling.bin"));
  ASSERT_EQ(mkfifo(In("links/pipe.bin").c_str(), 0600), 0);
  Settle();
  EXPECT_THAT(Take(), ElementsAre("links/1.bin", "links/2.bin"));
  EXPECT_THAT(Refused(), UnorderedElementsAre("links/out.bin", "links/folder", "links/folder.bin",
                                              "links/loop.bin", "links/pipe.bin"));
  for (int i = 0; i < 4; ++i) Pass(3.0);
  EXPECT_THAT(Refused(), ElementsAre("links/dangling.bin"));
  EXPECT_THAT(Take(), ElementsAre("a/1.bin"));
  EXPECT_EQ(inbox_->waiting(), 0U);
}

TEST_P(InboxArrivalTest, ALinkWaitsForWhatItLeadsTo) {
  Open();
  fs::create_symlink(".staged", In("1.bin"));
  Drop("2.bin");
  Settle();
  EXPECT_THAT(Take(), IsEmpty());
  Write("in/.staged", OnePoint());
  Settle();
  EXPECT_THAT(Take(), ElementsAre("1.bin", "2.bin"));
}

TEST_P(InboxArrivalTest, TheInboxThatGoesIsAnError) {
  Open();
  Pass(0.6);
  fs::rename(Path("in"), Path("moved"));
  EXPECT_THAT(MessageOf<InputError>([&] { inbox_->Next(); }), HasSubstr("in: the inbox is gone"));
  fs::create_directories(Path("in"));
  Open();
  Pass(0.6);
  fs::remove_all(Path("in"));
  EXPECT_THAT(MessageOf<InputError>([&] { inbox_->Wait(std::chrono::seconds(60)); }),
              HasSubstr("in: the inbox is gone"));
}

TEST_P(InboxArrivalTest, KeptFilesAreNotAskedForAgainAndCostFewBytes) {
  constexpr int kFiles = 2000;
  for (int i = 0; i < kFiles; ++i) DropOld(std::to_string(i) + ".bin");
  known_ = {"0.bin", "1.bin"};
  Open();
  Settle();
  EXPECT_EQ(Take().size(), kFiles - 2U);
  for (int i = 0; i < 10; ++i) Settle();
  inbox_->Drain();
  EXPECT_THAT(Take(), IsEmpty());
  EXPECT_EQ(asked_.size(), std::size_t{kFiles});
  for (const auto& [name, times] : asked_) EXPECT_EQ(times, 1) << name;
  EXPECT_LE(inbox_->seen_bytes(), 16U * kFiles);
}

TEST_P(InboxArrivalTest, DrainTakesAllThatIsThereAtOnceAndNothingAfter) {
  Open();
  Drop("1.bin");
  Write("in/2.bin", "12345");
  inbox_->Drain();
  Drop("3.bin");
  EXPECT_EQ(inbox_->Wait(std::chrono::seconds(60)), Woken::kReady);
  EXPECT_THAT(Take(), ElementsAre("1.bin", "2.bin"));
  EXPECT_EQ(inbox_->Wait(std::chrono::seconds(60)), Woken::kTimeout);
}

TEST_P(InboxArrivalTest, WaitEndsWhenAFileComesOrAnotherThreadOrASignalSaysSo) {
  options_.poll_period_s = 0.01;
  options_.settle_s = 0.01;
  options_.reorder_wait_s = 0.0;
  inbox_ = std::make_unique<Inbox>(Path("in"), scans_, options_, nullptr);
  std::thread writer([&] {
    Drop("1.bin");
    Drop("2.bin");
  });
  EXPECT_EQ(inbox_->Wait(std::chrono::seconds(500)), Woken::kReady);
  writer.join();
  EXPECT_FALSE(TakeFiles().empty());
  while (inbox_->waiting() > 0) {
    if (inbox_->Wait(std::chrono::seconds(500)) == Woken::kReady) Take();
  }
  std::thread interrupter([&] { inbox_->Interrupt(); });
  EXPECT_EQ(inbox_->Wait(std::chrono::seconds(500)), Woken::kInterrupted);
  interrupter.join();

  static Inbox* target = nullptr;
  target = inbox_.get();
  struct sigaction action = {}, before = {};
  action.sa_handler = [](int) { target->Interrupt(); };
  ASSERT_EQ(sigaction(SIGALRM, &action, &before), 0);
  const itimerval timer = {{0, 0}, {0, 20000}};
  ASSERT_EQ(setitimer(ITIMER_REAL, &timer, nullptr), 0);
  EXPECT_EQ(inbox_->Wait(std::chrono::seconds(500)), Woken::kInterrupted);
  sigaction(SIGALRM, &before, nullptr);
  EXPECT_EQ(inbox_->Wait(std::chrono::milliseconds(1)), Woken::kTimeout);
}

TEST_P(InboxArrivalTest, ManyFilesAtOnce) {
  // More than the kernel's queue of events holds; in an order far from theirs.
  constexpr std::size_t kFiles = 20000;
  constexpr std::size_t kStep = 16411;  // a prime
  Open();
  const std::string bytes = OnePoint();
  for (std::size_t i = 0; i < kFiles; ++i) {
    Write("in/" + std::to_string(i * kStep % kFiles) + ".bin", bytes);
  }
  Settle();
  std::size_t next = 0;
  while (const auto file = inbox_->Next()) {
    ASSERT_EQ(file->name, std::to_string(next) + ".bin");
    ++next;
  }
  EXPECT_EQ(next, kFiles);
}

INSTANTIATE_TEST_SUITE_P(Watchers, InboxArrivalTest,
                         testing::Values(InboxOptions::Watch::kInotify, InboxOptions::Watch::kPoll),
                         [](const auto& test) {
                           return test.param == InboxOptions::Watch::kPoll ? "Poll" : "Inotify";
                         });

class InboxEventsTest : public InboxScene {
 protected:
  InboxEventsTest() { options_.watch = InboxOptions::Watch::kInotify; }
};

TEST_F(InboxEventsTest, ClosedFilesAreTakenWithoutAnyWait) {
  options_.reorder_wait_s = 0.0;
  Open();
  Drop("1.bin");
  EXPECT_THAT(Take(), IsEmpty());
  Drop("2.bin");
  EXPECT_THAT(Take(), ElementsAre("1.bin", "2.bin"));
  Drop("3.bin");
  EXPECT_EQ(inbox_->Wait(std::chrono::seconds(0)), Woken::kReady);
  EXPECT_THAT(Take(), ElementsAre("3.bin"));
}

TEST_F(InboxEventsTest, AFileThatIsWrittenToAfterItWasTakenIsToldOnce) {
  Open();
  Drop("1.bin");
  Drop("2.bin");
  Pass(0.21);
  EXPECT_THAT(Take(), ElementsAre("1.bin", "2.bin"));
  for (int i = 0; i < 3; ++i) Drop("1.bin");  // in place
  EXPECT_THAT(Take(), IsEmpty());
  const auto refused = inbox_->TakeRefused();
  ASSERT_EQ(refused.size(), 1U);
  EXPECT_EQ(refused[0].name, "1.bin");
  EXPECT_THAT(refused[0].reason, HasSubstr("written to after it was taken"));
}

TEST_F(InboxEventsTest, AFileMadeAgainUnderATakenNameIsRefused) {
  Open();
  Drop("1.bin");
  Drop("2.bin");
  Pass(0.21);
  EXPECT_THAT(Take(), ElementsAre("1.bin", "2.bin"));
  fs::remove(In("1.bin"));
  Drop("1.bin");
  EXPECT_THAT(Take(), IsEmpty());
  const auto refused = inbox_->TakeRefused();
  ASSERT_EQ(refused.size(), 1U);
  EXPECT_THAT(refused[0].reason, HasSubstr("taken before"));
}

TEST_F(InboxEventsTest, AFileThatVanishesUnseenIsPassedOver) {
  options_.watch = InboxOptions::Watch::kPoll;
  for (const char* name : {"1.bin", "2.bin", "3.bin"}) Drop(name);
  Open();
  for (int i = 0; i < 4; ++i) Pass(0.51);
  EXPECT_EQ(inbox_->Next()->name, "1.bin");
  fs::remove(In("2.bin"));
  EXPECT_THAT(Take(), ElementsAre("3.bin"));
  EXPECT_EQ(inbox_->waiting(), 0U);
}

TEST_F(InboxEventsTest, WaitKnowsWhenAWaitEnds) {
  options_.reorder_wait_s = 0.02;
  inbox_ = std::make_unique<Inbox>(Path("in"), scans_, options_, nullptr);
  Drop("1.bin");
  Drop("2.bin");
  EXPECT_EQ(inbox_->Wait(std::chrono::seconds(500)), Woken::kReady);
  EXPECT_THAT(Take(), ElementsAre("1.bin", "2.bin"));
  EXPECT_EQ(inbox_->Wait(std::chrono::milliseconds(1)), Woken::kTimeout);
}

TEST(NameSetTest, HoldsWhatWasInserted) {
  NameSet set;
  for (int i = 0; i < 100000; i += 2) set.Insert(std::to_string(i));
  set.Insert("0");
  EXPECT_EQ(set.size(), 50000U);
  int found = 0;
  for (int i = 0; i < 100000; ++i) found += set.Contains(std::to_string(i)) == (i % 2 == 0) ? 1 : 0;
  EXPECT_EQ(found, 100000);
  EXPECT_LE(set.bytes(), 16U * set.size());
}

}  // namespace
}  // namespace lamina
