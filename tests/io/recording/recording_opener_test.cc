#include "io/recording/recording_opener.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <future>

#include "io/stream/byte_stream.h"
#include "tests/support/files/container_files.h"

namespace lamina {
namespace {

using testing::HasSubstr;

class RecordingOpenerTest : public FilesTest {
 protected:
  std::string WriteBag(const std::string& name, int scans) const {
    RecordedMessages recorded;
    recorded.topics = {{"/points", "sensor_msgs/PointCloud2"}};
    for (int i = 0; i < scans; ++i) {
      Scan scan;
      scan.points = {{1, 2, 3, 4}};
      const StampNs stamp_ns = 1'700'000'000'000'000'000 + i * 100'000'000LL;
      recorded.messages.push_back(
          {0, stamp_ns, CloudMessage(WireWriter::Form::kRos1, stamp_ns, scan)});
    }
    return Write(name, BagBytes(recorded, {"none", 3, false}));
  }
};

TEST_F(RecordingOpenerTest, OpensOneAfterTheOther) {
  std::promise<void> opened;
  RecordingOpener opener([&opened] { opened.set_value(); });
  EXPECT_FALSE(opener.busy());
  opener.Begin(WriteBag("a.bag", 3), {});
  EXPECT_TRUE(opener.busy());
  EXPECT_THROW(opener.Begin(Path("a.bag"), {}), std::logic_error);
  opened.get_future().wait();
  EXPECT_TRUE(opener.done());
  EXPECT_EQ(opener.Take().scans->size(), 3U);
  EXPECT_FALSE(opener.busy());
  EXPECT_FALSE(opener.done());
  opened = {};
  opener.Begin(WriteBag("b.bag", 5), {});
  EXPECT_EQ(opener.Take().scans->size(), 5U) << "waits";
  EXPECT_THROW(opener.Take(), std::logic_error);
}

TEST_F(RecordingOpenerTest, WhatCannotBeReadSaysWhy) {
  RecordingOpener opener;
  opener.Begin(Path("none.bag"), {});
  RecordingOpener::Opened opened = opener.Take();
  EXPECT_EQ(opened.scans, nullptr);
  EXPECT_THAT(opened.error, HasSubstr("none.bag"));
  opener.Begin(WriteBag("a.bag", 1), {});
  opened = opener.Take();
  EXPECT_NE(opened.scans, nullptr);
  EXPECT_EQ(opened.error, "");
}

TEST_F(RecordingOpenerTest, ReadingEndsWhenItIsGivenUp) {
  const RandomFile file(WriteBag("a.bag", 3));
  std::atomic<bool> given_up{false};
  char head[8];
  {
    const GiveUpReads scope(&given_up);
    EXPECT_EQ(file.ReadAt(0, head, sizeof(head)), sizeof(head));
    given_up = true;
    EXPECT_THAT(MessageOf<InputError>([&] { file.ReadAt(0, head, sizeof(head)); }),
                HasSubstr("not wanted any more"));
  }
  EXPECT_EQ(file.ReadAt(0, head, sizeof(head)), sizeof(head));
  RecordingOpener opener;
  opener.Begin(file.path(), {});
}

}  // namespace
}  // namespace lamina
