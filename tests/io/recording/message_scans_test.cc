// Scans of a recording that is a container of messages, and the choice of their topic.
#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <thread>

#include "io/container/message_container.h"
#include "io/message/lidar_message.h"
#include "io/recording/scan_source.h"
#include "tests/support/files/container_files.h"

namespace lamina {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::FloatNear;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::Pointwise;

constexpr StampNs kFirstNs = 1700000000000000000, kMessagePeriod = 100'000'000;
constexpr char kCloudType[] = "sensor_msgs/PointCloud2";

Scan SomeScan(int i) {
  Scan scan;
  for (int k = 0; k < 50; ++k) {
    scan.points.push_back({1.0F + static_cast<float>(i), static_cast<float>(k), 2.0F, 3.0F});
    scan.time_s.push_back(0.001F * static_cast<float>(k));
  }
  return scan;
}

class MessageScansTest : public FilesTest {
 protected:
  // Messages come half a second after their stamps.
  static void Add(const RecordedTopic& topic, int scans, RecordedMessages* recorded,
                  bool stamps = true) {
    for (int i = 0; i < scans; ++i) {
      const StampNs stamp = kFirstNs + i * kMessagePeriod;
      recorded->messages.push_back(
          {recorded->topics.size(), stamp + 5 * kMessagePeriod,
           CloudMessage(WireWriter::Form::kCdr, stamps ? stamp : 0, SomeScan(i))});
    }
    recorded->topics.push_back(topic);
  }
  std::string Error(const std::string& path) const {
    return MessageOf<InputError>([&] { OpenScans(path, options_); });
  }
  ScanSourceOptions options_;
};

TEST_F(MessageScansTest, OneTopicIsFoundByItself) {
  RecordedMessages recorded;
  Add({"/front/points", kCloudType}, 4, &recorded);
  recorded.topics.push_back({"/imu", "sensor_msgs/Imu"});
  recorded.topics.push_back({"/unused", kCloudType});
  const std::string path = Write("drive.mcap", McapBytes(recorded, {}));
  const auto scans = OpenScans(path, options_);
  ASSERT_EQ(scans->size(), 4U);
  for (std::size_t i = 0; i < 4; ++i) {
    EXPECT_EQ(scans->Stamp(i), kFirstNs + static_cast<StampNs>(i) * kMessagePeriod);
    const Scan scan = scans->Read(i), expected = SomeScan(static_cast<int>(i));
    EXPECT_EQ(scan.stamp_ns, scans->Stamp(i));
    EXPECT_FALSE(scan.stamp_made_up);
    EXPECT_EQ(KittiBin(scan.points), KittiBin(expected.points));
    EXPECT_THAT(scan.time_s, Pointwise(FloatNear(1e-6F), expected.time_s));
  }
  EXPECT_EQ(scans->Name(2), path + "#2");
  EXPECT_EQ(scans->PointTimes(0).name, "t");
  const RecordingDescription said = scans->Describe();
  EXPECT_THAT(said.scans, AllOf(HasSubstr("4 messages"), HasSubstr("/front/points"),
                                HasSubstr("an MCAP file")));
  EXPECT_EQ(said.stamps, "from the messages");
  EXPECT_THAT(said.doubts, IsEmpty());
}

TEST_F(MessageScansTest, SeveralAreListedAndOneIsChosen) {
  RecordedMessages recorded;
  Add({"/front", kCloudType}, 4, &recorded);
  Add({"/rear", kCloudType}, 2, &recorded);
  recorded.topics.push_back({"/imu", "sensor_msgs/Imu"});
  const std::string path = Write("drive.mcap", McapBytes(recorded, {}));
  EXPECT_THAT(Error(path), AllOf(HasSubstr("2 topics of scans"), HasSubstr("--topic"),
                                 HasSubstr("/front (sensor_msgs/PointCloud2, 4 messages)"),
                                 HasSubstr("/rear (sensor_msgs/PointCloud2, 2 messages)"),
                                 testing::Not(HasSubstr("/imu"))));
  options_.topic = "/rear";
  EXPECT_EQ(OpenScans(path, options_)->size(), 2U);
  for (const char* wrong : {"/left", "/imu"}) {
    options_.topic = wrong;
    EXPECT_THAT(Error(path), AllOf(HasSubstr(wrong), HasSubstr("/front"), HasSubstr("/imu")));
  }
  options_.topic = "/rear";
  Write("folder/1.bin", KittiBin(SomeScan(0).points));
  EXPECT_THAT(Error(Path("folder")), HasSubstr("there is no topic '/rear'"));
}

TEST_F(MessageScansTest, WithoutScansItSaysWhatThereIs) {
  RecordedMessages recorded;
  recorded.topics = {{"/imu", "sensor_msgs/Imu"}};
  recorded.messages = {{0, 5, "imu"}};
  EXPECT_THAT(Error(Write("a.mcap", McapBytes(recorded, {}))),
              AllOf(HasSubstr("holds no scans"), HasSubstr("/imu (sensor_msgs/Imu, 1 messages)"),
                    HasSubstr("sensor_msgs/PointCloud2"), HasSubstr("ouster_ros/PacketMsg"),
                    HasSubstr("ouster_msgs/PacketMsg"), HasSubstr("ouster_sensor_msgs/PacketMsg")));
  EXPECT_THAT(Error(Write("a.md", "text")),
              AllOf(HasSubstr("no folder that holds scans"), HasSubstr("no ROS 1 bag")));
}

TEST_F(MessageScansTest, TimesOfRecordingWhereMessagesHaveNone) {
  RecordedMessages recorded;
  Add({"/points", kCloudType}, 3, &recorded, false);
  const auto scans = OpenScans(Write("a.mcap", McapBytes(recorded, {})), options_);
  EXPECT_EQ(scans->Describe().stamps, "the times of recording");
  EXPECT_EQ(scans->Stamp(1), kFirstNs + 6 * kMessagePeriod);
  EXPECT_EQ(scans->Read(1).stamp_ns, kFirstNs + 6 * kMessagePeriod);
}

TEST_F(MessageScansTest, ADamagedScanIsAnErrorOfItsOwn) {
  RecordedMessages recorded;
  Add({"/points", kCloudType}, 4, &recorded);
  recorded.messages[2].bytes.resize(300);
  const std::string path = Write("a.mcap", McapBytes(recorded, {}));
  const auto scans = OpenScans(path, options_);
  EXPECT_EQ(scans->Stamp(2), kFirstNs + 2 * kMessagePeriod);
  EXPECT_THAT(MessageOf<InputError>([&] { scans->Read(2); }), HasSubstr(path + "#2: "));
  EXPECT_EQ(scans->Read(3).points.size(), 50U);
}

TEST_F(MessageScansTest, FoldersOfScansStayThat) {
  RecordedMessages recorded;
  Add({"/points", kCloudType}, 3, &recorded);
  Write("both/a.mcap", McapBytes(recorded, {}));
  EXPECT_EQ(OpenScans(Path("both"), options_)->size(), 3U);
  Write("both/1.bin", KittiBin(SomeScan(0).points));
  EXPECT_EQ(OpenScans(Path("both"), options_)->size(), 1U);
}

TEST_F(MessageScansTest, ManyThreadsReadAtOnce) {
  RecordedMessages recorded;
  Add({"/points", kCloudType}, 40, &recorded);
  for (const bool database : {false, true}) {
    std::string path = Path("a.db3");
    if (database) WriteDatabase(path, recorded);
    if (!database) path = Write("a.mcap", McapBytes(recorded, {}));
    const auto scans = OpenScans(path, options_);
    std::vector<std::thread> threads;
    std::atomic<int> right{0};
    for (std::size_t t = 0; t < 4; ++t) {
      threads.emplace_back([&, t] {
        for (std::size_t k = 0; k < 40; ++k) {
          const std::size_t i = (k * 7 + t * 11) % 40;
          right += scans->Read(i).points[0].x == 1.0F + static_cast<float>(i) ? 1 : 0;
        }
      });
    }
    for (std::thread& thread : threads) thread.join();
    EXPECT_EQ(right, 160);
  }
}

// Recordings of known content, made with other programs; expected.json tells what is in them.
class KnownRecordings : public testing::Test {
 protected:
  void SetUp() override {
    const char* recordings = std::getenv("LAMINA_RECORDINGS");
    if (recordings != nullptr) folder_ = std::filesystem::path(recordings) / "formats" / "made";
    if (folder_.empty() || !std::filesystem::exists(folder_ / "expected.json")) {
      GTEST_SKIP() << "LAMINA_RECORDINGS names no folder with formats/made/expected.json";
    }
  }
  static void ExpectScan(const ScanSource& scans, std::size_t i, const nlohmann::json& expected) {
    SCOPED_TRACE(i);
    const Scan scan = scans.Read(i);
    EXPECT_EQ(scan.stamp_ns, expected["stamp_ns"].get<StampNs>());
    ASSERT_EQ(scan.points.size(), expected["points"].get<std::size_t>());
    ASSERT_EQ(scan.time_s.size(), scan.points.size());
    double sum[3] = {0, 0, 0}, time_ns = 0;
    for (const ScanPoint& p : scan.points) {
      sum[0] += p.x, sum[1] += p.y, sum[2] += p.z;
    }
    for (const float t : scan.time_s) time_ns += 1e9 * t;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      EXPECT_NEAR(sum[axis], expected["sum_xyz"][axis].get<double>(), 2e-3);
    }
    // A double holds readings of a clock to 240 ns.
    constexpr double kToleranceNs = 600.0;
    const auto [first, last] = std::minmax_element(scan.time_s.begin(), scan.time_s.end());
    EXPECT_NEAR(1e9 * *first, expected["first_time_ns"].get<double>(), kToleranceNs);
    EXPECT_NEAR(1e9 * *last, expected["last_time_ns"].get<double>(), kToleranceNs);
    EXPECT_NEAR(time_ns / static_cast<double>(scan.points.size()),
                expected["sum_time_ns"].get<double>() / static_cast<double>(scan.points.size()),
                kToleranceNs);
  }
  std::filesystem::path folder_;
};

TEST_F(KnownRecordings, HoldWhatTheyShould) {
  std::ifstream file(folder_ / "expected.json");
  const nlohmann::json all = nlohmann::json::parse(file);
  EXPECT_GE(all.size(), 18U);
  for (const auto& [name, expected] : all.items()) {
    SCOPED_TRACE(name);
    const std::string path = (folder_ / name).string();
    const auto scans = OpenScans(path, {});
    ASSERT_EQ(scans->size(), expected["scans"].size());
    for (std::size_t i = 0; i < scans->size(); ++i) ExpectScan(*scans, i, expected["scans"][i]);
    const auto container = OpenMessageContainer(path, IsLidarTopic);
    std::uint64_t imu = 0;
    for (const MessageTopic& topic : container->topics()) {
      if (topic.type == "sensor_msgs/Imu") imu += topic.messages;
      if (!IsLidarTopic(topic)) continue;
      EXPECT_EQ(topic.name, expected["topic"]);
      EXPECT_EQ(topic.type, expected["type"]);
      const auto at = static_cast<std::size_t>(&topic - container->topics().data());
      LidarMessageInfo info;
      ScanFromMessage(topic, container->Read(container->Messages(at).at(0)), PointTimeUnit::kAuto,
                      name, &info);
      EXPECT_EQ(info.frame_id, expected["frame_id"]);
      EXPECT_EQ(info.cells, expected["scans"][0]["cells"].get<std::uint64_t>());
    }
    // Of damaged files the number is that of the whole recording.
    if (expected.contains("cut")) {
      EXPECT_LT(imu, expected["imu_messages"].get<std::uint64_t>());
    } else {
      EXPECT_EQ(imu, expected["imu_messages"].get<std::uint64_t>());
    }
  }
}

TEST_F(KnownRecordings, WithoutScansSayWhatTheyHold) {
  const std::filesystem::path formats = folder_.parent_path();
  for (const auto& [name, holds] : std::vector<std::pair<const char*, const char*>>{
           {"rosbag1/example.bag", "/tf (tf/tfMessage, 2688 messages)"},
           {"rosbag1/example-bz2.bag", "/turtle1/pose (turtlesim/Pose, 1344 messages)"},
           {"rosbag1/example-lz4.bag", "/turtle1/pose (turtlesim/Pose, 1344 messages)"},
           {"rosbag1/no-messages.bag", "it holds no message"},
           {"rosbag2_talker", "/topic (std_msgs/String, 10 messages)"},
           {"rosbag2_split", "/chatter (std_msgs/String, 3177 messages)"}}) {
    EXPECT_THAT(MessageOf<InputError>([&] { OpenScans((formats / name).string(), {}); }),
                AllOf(HasSubstr("holds no scans"), HasSubstr(holds)));
  }
}

}  // namespace
}  // namespace lamina
