// The inbox by what is in it: order, stamps, waits, late files. inotify; see also
// inbox_arrival_test.cc.
#include "io/inbox/inbox.h"

#include <cmath>

#include "tests/support/files/inbox_scenes.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Optional;

class InboxTest : public InboxScene {
 protected:
  InboxTest() { options_.watch = InboxOptions::Watch::kInotify; }

  static std::vector<StampNs> Stamps(const std::vector<InboxFile>& files) {
    std::vector<StampNs> stamps;
    for (const InboxFile& file : files) stamps.push_back(file.stamp_ns);
    return stamps;
  }

  // That a drained inbox gives for the folder what a recording gives.
  void ExpectAsRecording(const std::string& sequence) {
    const auto source = OpenScans(In(sequence), scans_);
    Open();
    inbox_->Drain();
    std::vector<InboxFile> files = TakeFiles();
    ASSERT_EQ(files.size(), source->size());
    for (std::size_t i = 0; i < files.size(); ++i) {
      EXPECT_TRUE(fs::equivalent(files[i].path, source->Name(i))) << files[i].path;
      EXPECT_EQ(files[i].stamp_ns, source->Stamp(i));
      const Scan a = source->Read(i);
      const Scan b =
          ReadStampedScan(files[i].path, files[i].stamp_ns, files[i].recorded_stamp, scans_);
      EXPECT_EQ(a.stamp_ns, b.stamp_ns);
      EXPECT_EQ(a.time_s, b.time_s);
    }
    if (files.size() > 1) {
      EXPECT_THAT(files[0].next_stamp_ns, Optional(source->Stamp(1)));
    }
    EXPECT_EQ(inbox_->waiting(), 0U);
    EXPECT_THAT(Refused(), IsEmpty());
    EXPECT_THAT(Late(), IsEmpty());
  }
};

TEST_F(InboxTest, DrainedItIsARecordingInAnyLayout) {
  for (const char* name : {"scan10.bin", "scan2.bin", "scan02.bin", "scan.bin"}) {
    Drop(std::string("plain/") + name);
  }
  ExpectAsRecording("plain");
  fs::remove_all(In("plain"));
  for (const char* name : {"1.5.bin", "1.25.bin", "1317384506.400123001.bin"}) {
    Drop(std::string("named/") + name);
  }
  ExpectAsRecording("named");
  fs::remove_all(In("named"));
  for (const char* name : {"7.bin", "8.bin", "9.bin"}) Drop(std::string("00/velodyne/") + name);
  Write("in/00/times.txt", "0.0\n0.1\n0.25");
  ExpectAsRecording("00");
  // One more line, and names that fit as line numbers from 0, say which are meant.
  Drop("00/velodyne/1.bin");
  Write("in/00/times.txt", "0\n1\n2\n3\n4\n5\n6\n7\n8\n9\n10\n");
  ExpectAsRecording("00");
  fs::remove_all(In("00"));
  Write("in/d/velodyne_points/data/0000000000.txt", "1 2 3 0.5\n");
  Write("in/d/velodyne_points/data/0000000002.txt", "1 2 3 0.5\n");
  Write("in/d/velodyne_points/timestamps.txt",
        "1970-01-01 00:00:01.0\n1970-01-01 00:00:02.0\n1970-01-01 00:00:03.0\n");
  ExpectAsRecording("d");
  // Text is a scan only where there is no other.
  Drop("d/velodyne_points/data/0000000001.bin");
  ExpectAsRecording("d");
}

TEST_F(InboxTest, PointTimesAreThoseOfARecording) {
  const std::string header =
      "ply\nformat ascii 1.0\nelement vertex 2\nproperty float x\nproperty float y\n"
      "property float z\nproperty double t\nend_header\n";
  Write("in/s/1700000000.50.ply", header + "1 2 3 1700000000.25\n4 5 6 1700000000.75\n");
  ExpectAsRecording("s");
}

TEST_F(InboxTest, TheInboxItselfMayBeTheFolderOfAKittiSequence) {
  fs::remove(Path("in"));
  Write("00/velodyne/000000.bin", OnePoint());
  Write("00/velodyne/000001.bin", OnePoint());
  Write("00/times.txt", "5\n6\n");
  inbox_ = std::make_unique<Inbox>(Path("00/velodyne"), scans_, options_, nullptr);
  inbox_->Drain();
  EXPECT_THAT(Stamps(TakeFiles()), ElementsAre(5'000'000'000, 6'000'000'000));
}

TEST_F(InboxTest, FilesComeInTheOrderOfTheirNamesAndAtOnceWhenNothingIsMissing) {
  Open();
  Drop("scan_8.bin");
  Drop("scan_9.bin");
  EXPECT_THAT(Take(), IsEmpty());  // an earlier one may come
  Pass(0.21);
  EXPECT_THAT(Take(), ElementsAre("scan_8.bin", "scan_9.bin"));
  Drop("scan_10.bin");
  EXPECT_THAT(Take(), ElementsAre("scan_10.bin"));
  Drop("scan_12.bin");
  EXPECT_THAT(Take(), IsEmpty());
  Pass(0.1);
  Drop("scan_11.bin");
  EXPECT_THAT(Take(), ElementsAre("scan_11.bin", "scan_12.bin"));
  Drop("scan_14.bin");
  Pass(0.21);
  EXPECT_THAT(Take(), ElementsAre("scan_14.bin"));
  Drop("scan_13.bin");
  Drop("scan_15.bin");
  EXPECT_THAT(Take(), ElementsAre("scan_15.bin"));
  EXPECT_THAT(Late(), ElementsAre("scan_13.bin"));
  EXPECT_THAT(Late(), IsEmpty());
  EXPECT_EQ(inbox_->waiting(), 0U);
}

TEST_F(InboxTest, StampsInNamesSayTheOrderAndThePace) {
  Open();
  Drop("1.5.bin");
  Drop("1.40.bin");
  Drop("1.3.bin");
  Pass(0.21);
  EXPECT_THAT(Take(), ElementsAre("1.3.bin", "1.40.bin", "1.5.bin"));
  for (const char* name : {"1.6.bin", "1.7.bin", "1.8.bin", "1.9.bin", "2.0.bin", "2.1.bin"}) {
    Drop(name);
    EXPECT_THAT(Take(), IsEmpty());
    Pass(0.21);
    EXPECT_THAT(Take(), ElementsAre(name));
  }
  // Eight gaps, of 0.1 s at least: what follows within 0.15 s follows at once.
  Drop("2.2.bin");
  EXPECT_THAT(Take(), ElementsAre("2.2.bin"));
  Drop("2.4.bin");
  EXPECT_THAT(Take(), IsEmpty());
  Drop("2.3.bin");
  const auto files = TakeFiles();
  EXPECT_THAT(Stamps(files), ElementsAre(2'300'000'000, 2'400'000'000));
  ASSERT_FALSE(files.empty());
  EXPECT_TRUE(files[0].recorded_stamp);
  Drop("2.35.bin");
  Drop("a.bin");
  EXPECT_THAT(Take(), IsEmpty());
  EXPECT_THAT(Late(), ElementsAre("2.35.bin"));
  EXPECT_THAT(Refused(), ElementsAre("a.bin"));
}

TEST_F(InboxTest, TheFirstWaitsForTheSecondAndTellsItsStamp) {
  Open();
  Drop("1.5.bin");
  Pass(9.9);
  EXPECT_THAT(Take(), IsEmpty());
  Drop("1.75.bin");
  Pass(0.05);
  EXPECT_THAT(Take(), IsEmpty());  // one between them may come
  Drop("1.6.bin");
  Pass(0.2);
  const auto files = TakeFiles();
  ASSERT_EQ(files.size(), 3U);
  EXPECT_THAT(files[0].next_stamp_ns, Optional(1'600'000'000));
  EXPECT_FALSE(files[1].next_stamp_ns);
}

TEST_F(InboxTest, TheFirstGoesAloneWhenNoSecondComes) {
  Open();
  Drop("a.bin");
  Pass(10.1);
  const auto files = TakeFiles();
  ASSERT_EQ(files.size(), 1U);
  EXPECT_FALSE(files[0].next_stamp_ns);
  EXPECT_FALSE(files[0].recorded_stamp);
  Drop("b.bin");
  Pass(0.21);
  EXPECT_THAT(Stamps(TakeFiles()), ElementsAre(100'000'000));
}

TEST_F(InboxTest, SequencesTakeTurnsInNaturalOrderOfFolders) {
  for (const char* name : {"s10/0.bin", "s10/1.bin", "s9/0.bin", "s9/1.bin", "0.bin", "1.bin"}) {
    DropOld(name);
  }
  Open();
  Pass(0.21);
  const auto files = TakeFiles();
  EXPECT_THAT(Stamps(files), ElementsAre(0, 100000000, 0, 100000000, 0, 100000000));
  ASSERT_EQ(files.size(), 6U);
  EXPECT_EQ(files[0].sequence, "");
  EXPECT_EQ(files[2].name, "s9/0.bin");
  EXPECT_EQ(files[5].sequence, "s10");
}

TEST_F(InboxTest, AFileWaitsForItsLineInTheStampFile) {
  Write("in/00/times.txt", "0.5\n0.6");
  fs::create_directories(In("00/velodyne"));
  Open();
  Drop("00/velodyne/000000.bin");
  Drop("00/velodyne/000001.bin");
  Drop("00/velodyne/000002.bin");
  Pass(0.5);
  EXPECT_THAT(Take(), IsEmpty());  // 0.6 may be the beginning of 0.65
  std::ofstream times(In("00/times.txt"), std::ios::app);
  times << "5\n" << std::flush;  // written, not closed
  EXPECT_THAT(Stamps(TakeFiles()), ElementsAre(500000000, 650000000));
  times << "0.75" << std::flush;
  EXPECT_THAT(Take(), IsEmpty());
  Pass(1.1);  // rests: the last line needs no end
  EXPECT_THAT(Stamps(TakeFiles()), ElementsAre(750000000));
}

TEST_F(InboxTest, AScanWhoseStampNeverComesIsRefused) {
  Write("in/times.txt", "1\n2\nx\n4\n");
  Open();
  for (const char* name : {"a.bin", "b.bin", "c.bin", "d.bin", "e.bin"}) Drop(name);
  Pass(0.21);
  EXPECT_THAT(Stamps(TakeFiles()), ElementsAre(1'000'000'000, 2'000'000'000, 4'000'000'000));
  const auto bad = inbox_->TakeRefused();
  ASSERT_EQ(bad.size(), 1U);
  EXPECT_EQ(bad[0].name, "c.bin");
  EXPECT_THAT(bad[0].reason, HasSubstr("times.txt: stamp 3 must be"));
  Pass(10.0);
  EXPECT_THAT(Take(), IsEmpty());
  const auto missing = inbox_->TakeRefused();
  ASSERT_EQ(missing.size(), 1U);
  EXPECT_EQ(missing[0].name, "e.bin");
  EXPECT_THAT(missing[0].reason, HasSubstr("ends after 4 stamps, stamp 5 is wanted"));
}

TEST_F(InboxTest, NumbersAreLineNumbersInAStream) {
  Write("in/times.txt", "0\n1\n2\n3\n");
  Open();
  Drop("3.bin");
  Drop("1.bin");
  Pass(0.21);
  EXPECT_THAT(Stamps(TakeFiles()), ElementsAre(1'000'000'000, 3'000'000'000));
}

TEST_F(InboxTest, AStampFileMayComeAfterTheFirstFiles) {
  Open();
  Drop("1.5.bin");
  Drop("1.6.bin");
  Pass(0.1);
  EXPECT_THAT(Take(), IsEmpty());
  Write("in/timestamps.txt", "7\n8\n");
  Pass(0.2);
  EXPECT_THAT(Stamps(TakeFiles()), ElementsAre(7'000'000'000, 8'000'000'000));
}

TEST_F(InboxTest, KnownFilesAreAskedForOnceAndNotHandedOut) {
  for (const char* name : {"1.bin", "2.bin", "3.bin"}) DropOld(name);
  known_ = {"1.bin", "2.bin"};
  Open();
  inbox_->Continue({"", 2, "2.bin", 100'000'000, false});
  EXPECT_THAT(Stamps(TakeFiles()), ElementsAre(200'000'000));
  Pass(1000.0);
  inbox_->Drain();  // looks again
  EXPECT_THAT(Take(), IsEmpty());
  EXPECT_THAT(asked_,
              ElementsAre(std::pair("1.bin", 1), std::pair("2.bin", 1), std::pair("3.bin", 1)));
}

TEST_F(InboxTest, ASequenceContinuesWithItsStampsAndOrder) {
  DropOld("1.4.bin");
  DropOld("1.6.bin");
  Open();
  inbox_->Continue({"", 7, "1.5.bin", 1'500'000'000, true});
  Pass(0.21);
  EXPECT_THAT(Stamps(TakeFiles()), ElementsAre(1'600'000'000));
  EXPECT_THAT(Late(), ElementsAre("1.4.bin"));
}

TEST_F(InboxTest, ASequenceContinuesInTheLinesOfItsStampFile) {
  // Names from 1 took the lines in order: the last stamp tells.
  Write("in/a/times.txt", "10\n11\n12\n13\n");
  for (const char* name : {"3.bin", "4.bin"}) DropOld(std::string("a/") + name);
  // By numbers, with a gap.
  Write("in/b/times.txt", "10\n11\n12\n13\n14\n");
  DropOld("b/4.bin");
  // In order, where a file was set aside.
  Write("in/c/times.txt", "10\n11\n12\n13\n14\n");
  DropOld("c/z.bin");
  Open();
  inbox_->Continue({"a", 2, "a/2.bin", 11'000'000'000, true});
  inbox_->Continue({"b", 2, "b/2.bin", 12'000'000'000, true});
  inbox_->Continue({"c", 2, "c/d.bin", 12'000'000'000, true});
  inbox_->Drain();
  EXPECT_THAT(Stamps(TakeFiles()),
              ElementsAre(12'000'000'000, 13'000'000'000, 14'000'000'000, 13'000'000'000));
}

TEST_F(InboxTest, AnyNameThatAFileMayHave) {
  const std::vector<std::string> names = {"a b.bin", "new\nline.bin", "n\xff\xfe.bin",
                                          "z\xc3\xa9/\xe2\x82\xac 1.bin"};
  for (const std::string& name : names) DropOld(name);
  Open();
  inbox_->Drain();
  auto taken = Take();
  std::sort(taken.begin(), taken.end());
  auto wanted = names;
  std::sort(wanted.begin(), wanted.end());
  EXPECT_EQ(taken, wanted);
}

TEST_F(InboxTest, OptionsAndFolderAreChecked) {
  options_.poll_period_s = 0.0;
  EXPECT_THAT(MessageOf<OptionError>([&] { Open(); }), HasSubstr("inbox.poll_period_s"));
  options_.poll_period_s = 1.0;
  EXPECT_THAT(MessageOf<InputError>([&] { Inbox(Path("none"), scans_, options_, nullptr); }),
              HasSubstr("none: cannot be watched: No such file"));
  Write("file", "x");
  EXPECT_THAT(MessageOf<InputError>([&] { Inbox(Path("file"), scans_, options_, nullptr); }),
              HasSubstr("file: cannot be watched: is not a folder"));
}

}  // namespace
}  // namespace lamina
