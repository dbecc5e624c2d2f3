// Recordings in one file in the inbox: when they count, and their scans one by one.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <vector>

#include "tests/support/files/container_files.h"
#include "tests/support/files/inbox_scenes.h"
#include "tests/support/files/velodyne_files.h"

namespace lamina {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

constexpr StampNs kFirst = 1'700'000'000'000'000'000, kPeriod = 100'000'000;

class InboxRecordingsTest : public InboxScene {
 protected:
  static RecordedMessages Messages(WireWriter::Form form, int count) {
    RecordedMessages recorded;
    recorded.topics = {{"/points", "sensor_msgs/PointCloud2"}};
    for (int i = 0; i < count; ++i) {
      Scan scan;
      scan.points = {{static_cast<float>(i + 1), 0, 0, 0}};
      const StampNs stamp_ns = kFirst + i * kPeriod;
      recorded.messages.push_back({0, stamp_ns + 1000, CloudMessage(form, stamp_ns, scan)});
    }
    return recorded;
  }
  static std::string Bag(int count, bool closed = true) {
    return BagBytes(Messages(WireWriter::Form::kRos1, count), {"lz4", 2, closed});
  }
  static std::string Mcap(int count) {
    return McapBytes(Messages(WireWriter::Form::kCdr, count), {});
  }
};

TEST_F(InboxRecordingsTest, ScansComeOneByOneBehindOtherFiles) {
  Open();
  Write("in/b.bag", Bag(2));
  Write("in/a.mcap", Mcap(1));
  Pass(0.5);
  EXPECT_THAT(Take(), IsEmpty()) << "a recorder may write more beside it";
  EXPECT_EQ(inbox_->waiting(), 2U);
  Write("in/x/1.bin", OnePoint());
  Write("in/x/2.bin", OnePoint());
  Pass(1.0);
  const std::vector<InboxFile> files = TakeFiles();
  std::vector<std::string> names;
  for (const InboxFile& file : files) names.push_back(file.name);
  EXPECT_THAT(names, ElementsAre("x/1.bin", "x/2.bin", "a.mcap#0", "b.bag#0", "b.bag#1"));
  ASSERT_EQ(files.size(), 5U);
  EXPECT_EQ(files[3].sequence, "b.bag");
  EXPECT_EQ(files[3].stamp_ns, kFirst);
  EXPECT_EQ(files[3].next_stamp_ns, kFirst + kPeriod);
  EXPECT_TRUE(files[3].recorded_stamp);
  EXPECT_EQ(files[4].recording->Read(files[4].scan_in_recording).points[0].x, 2.0F);
  EXPECT_THAT(Names(inbox_->TakeEnded()), ElementsAre("a.mcap", "b.bag"));
  EXPECT_EQ(inbox_->waiting(), 0U);
  EXPECT_THAT(Refused(), IsEmpty());
}

TEST_F(InboxRecordingsTest, OneThatIsStillWrittenIsNotTakenBeforeItIsWhole) {
  options_.incomplete_wait_s = 30.0;
  Open();
  const std::string bag = Bag(3), mcap = Mcap(3);
  // Closed in between, as a copy that is resumed.
  Write("in/a.bag", bag.substr(0, bag.size() / 2));
  Write("in/b.mcap", mcap.substr(0, mcap.size() - 4));
  for (int i = 0; i < 8; ++i) {
    Pass(2.0);
    EXPECT_THAT(Take(), IsEmpty());
  }
  Write("in/a.bag", bag);
  Write("in/b.mcap", mcap);
  Pass(1.5);
  EXPECT_THAT(Take(), testing::SizeIs(6));
}

TEST_F(InboxRecordingsTest, WhatNeverGetsWholeIsReadAsFarAsItGoes) {
  Open();
  Write("in/a.bag", Bag(4, false));
  Pass(5.0);
  EXPECT_THAT(Take(), IsEmpty());
  Pass(7.0);
  inbox_->Wait(std::chrono::seconds(0));
  EXPECT_THAT(Take(), testing::SizeIs(4));
}

TEST_F(InboxRecordingsTest, ARos2BagCountsByItsMetadata) {
  Open();
  std::filesystem::create_directories(Path("in/bag"));
  WriteDatabase(Path("in/bag/bag_0.db3"), Messages(WireWriter::Form::kCdr, 2));
  Write("in/bag/extra.mcap", Mcap(1));
  Pass(20.0);
  EXPECT_THAT(Take(), ElementsAre("bag/extra.mcap#0"));
  // Copied before the files that it names.
  Write("in/bag/metadata.yaml", Metadata({"bag_0.db3", "bag_1.db3"}));
  Pass(5.0);
  EXPECT_THAT(Take(), IsEmpty());
  WriteDatabase(Path("in/bag/bag_1.db3"), Messages(WireWriter::Form::kCdr, 3));
  Pass(2.0);
  Pass(2.0);
  Pass(2.0);
  EXPECT_THAT(Take(), testing::SizeIs(5));
  // Of another program.
  Write("in/other/metadata.yaml", "a: 1\n");
  Pass(2.0);
  Pass(2.0);
  EXPECT_THAT(Take(), IsEmpty());
  EXPECT_THAT(Refused(), IsEmpty());
}

TEST_F(InboxRecordingsTest, PartsAreNotMappedTwice) {
  Open();
  Write("in/bag/bag_0.mcap", Mcap(2));
  Pass(0.5);
  Write("in/bag/bag_1.mcap", Mcap(2));
  Write("in/bag/metadata.yaml", Metadata({"bag_0.mcap", "bag_1.mcap"}));
  Pass(2.0);
  EXPECT_THAT(Take(), testing::SizeIs(4));
  EXPECT_THAT(Names(inbox_->TakeEnded()), ElementsAre("bag/metadata.yaml"));
  // The first file of a recorder that began the next one long ago.
  Write("in/long/long_0.mcap", Mcap(2));
  Pass(2.0);
  EXPECT_THAT(Take(), testing::SizeIs(2));
  Write("in/long/long_1.mcap", Mcap(2));
  Write("in/long/metadata.yaml", Metadata({"long_0.mcap", "long_1.mcap"}));
  Pass(2.0);
  EXPECT_THAT(Take(), IsEmpty());
  const auto refused = inbox_->TakeRefused();
  ASSERT_EQ(refused.size(), 1U);
  EXPECT_THAT(refused[0].reason, HasSubstr("long/long_0.mcap was mapped by itself before"));
}

TEST_F(InboxRecordingsTest, ContinuesBehindTheLastScanOfAnEarlierLife) {
  Write("in/a.bag", Bag(4));
  Write("in/b.bag", Bag(4));
  Age("a.bag");
  Age("b.bag");
  known_ = {"b.bag"};
  Open();
  inbox_->Continue({"a.bag", 3, "a.bag#2", kFirst + 2 * kPeriod, true});
  inbox_->Continue({"b.bag", 4, "b.bag#3", kFirst + 3 * kPeriod, true});
  Pass(2.0);
  EXPECT_THAT(Take(), ElementsAre("a.bag#3"));
  EXPECT_THAT(Names(inbox_->TakeEnded()), ElementsAre("a.bag"));
}

TEST_F(InboxRecordingsTest, AnotherOfTheSameNameIsRefused) {
  Write("in/a.bag", Bag(4));
  Age("a.bag");
  Open();
  inbox_->Continue({"a.bag", 3, "a.bag#2", kFirst + 5 * kPeriod, true});
  Pass(2.0);
  EXPECT_THAT(Take(), IsEmpty());
  const auto refused = inbox_->TakeRefused();
  ASSERT_EQ(refused.size(), 1U);
  EXPECT_THAT(refused[0].reason, HasSubstr("another recording of this name"));
}

TEST_F(InboxRecordingsTest, WhatHoldsNoScansIsRefusedWithTheReason) {
  RecordedMessages imu;
  imu.topics = {{"/imu", "sensor_msgs/Imu"}};
  imu.messages = {{0, 5, "imu"}};
  Write("in/a.mcap", McapBytes(imu, {}));
  Write("in/b.pcap", "no capture");
  Open();
  inbox_->Drain();
  EXPECT_THAT(Take(), IsEmpty());
  const auto refused = inbox_->TakeRefused();
  ASSERT_EQ(refused.size(), 2U);
  EXPECT_THAT(refused[0].reason, HasSubstr("holds no scans"));
  EXPECT_EQ(refused[1].name, "b.pcap");
}

TEST_F(InboxRecordingsTest, SweepsOfACaptureAreScans) {
  std::string capture = PcapHead(false);
  StampNs stamp_ns = kFirst;
  for (std::uint32_t turn = 0; turn < 3; ++turn) {
    for (std::uint32_t azimuth = 0; azimuth < 36000; azimuth += 480) {
      capture += PcapPacket(
          stamp_ns, UdpFrame(RoundPacket(static_cast<std::uint16_t>(azimuth), 0), 1), false);
      stamp_ns += 1'327'000;
    }
  }
  Write("in/a.pcap", capture);
  Open();
  inbox_->Drain();
  EXPECT_THAT(Take(), ElementsAre("a.pcap#0", "a.pcap#1", "a.pcap#2"));
}

TEST_F(InboxRecordingsTest, WhatGoesBeforeItsTurnIsForgotten) {
  Open();
  Write("in/a.bag", Bag(2));
  Write("in/x/b.bag", Bag(2));
  Pass(0.2);
  std::filesystem::remove(In("a.bag"));
  std::filesystem::remove_all(In("x"));
  Pass(2.0);
  EXPECT_THAT(Take(), IsEmpty());
  EXPECT_THAT(Refused(), IsEmpty());
  EXPECT_EQ(inbox_->waiting(), 0U);
}

}  // namespace
}  // namespace lamina
