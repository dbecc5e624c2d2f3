// Sweeps of an Ouster sensor in messages that hold its packets.
#include <cstdlib>
#include <random>

#include "io/recording/scan_source.h"
#include "tests/support/files/container_files.h"
#include "tests/support/files/ouster_files.h"

namespace lamina {
namespace {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::SizeIs;

constexpr StampNs kFirstPacket = 1700000000000000000, kPacketsApart = 1'562'500;

class PacketScansTest : public FilesTest {
 protected:
  static constexpr int kChannels = 16;
  static constexpr const char* kProfile = "RNG19_RFL8_SIG16_NIR16";

  static std::string Message(WireWriter::Form form, const std::string& packet) {
    return WireWriter(form).Add(static_cast<std::uint32_t>(packet.size())).Raw(packet).Bytes();
  }
  static StampNs StampOf(std::size_t i) {
    return kFirstPacket + static_cast<StampNs>(i) * kPacketsApart;
  }
  // Frames of 4 packets, every channel at 5 m; packets of the IMU between; the metadata first.
  static RecordedMessages Record(std::size_t packets, const std::string& type,
                                 WireWriter::Form form, bool metadata = true,
                                 const std::string& behind = "") {
    RecordedMessages recorded;
    recorded.topics = {{"/os/imu_packets", type},
                       {"/os/lidar_packets", type},
                       {"/os/metadata", "std_msgs/String"}};
    if (metadata) {
      const std::string text = OusterMetadataText(kProfile, kChannels, true);
      recorded.messages.push_back({2, kFirstPacket, WireWriter(form).Text(text).Bytes()});
    }
    for (std::size_t i = 0; i < packets; ++i) {
      const std::string packet =
          OusterPacket(false, static_cast<std::uint16_t>(i / 4), static_cast<int>(i % 4) * 16,
                       kChannels, [](int, int) { return Pack(5000U, 0U, 0U); });
      recorded.messages.push_back({0, StampOf(i), Message(form, std::string(48, 'i'))});
      recorded.messages.push_back({1, StampOf(i), Message(form, packet + behind)});
    }
    return recorded;
  }
  void ExpectSweeps(const std::string& path) const {
    const auto scans = OpenScans(path, {});
    ASSERT_EQ(scans->size(), 3U);
    for (std::size_t i = 0; i < 3; ++i) {
      const Scan scan = scans->Read(i);
      EXPECT_THAT(scan.points, SizeIs(60 * kChannels));
      EXPECT_EQ(scan.stamp_ns, StampOf(4 * i));
      EXPECT_EQ(scans->Stamp(i), StampOf(4 * i));
      EXPECT_NEAR(scan.time_s.back(), 62e-4, 1e-7);
      EXPECT_NEAR(std::hypot(scan.points[0].x, scan.points[0].y, scan.points[0].z), 5.0, 0.1);
    }
    EXPECT_THAT(scans->Describe().scans,
                AllOf(HasSubstr("3 sweeps of 12 packets of OS-1-16, RNG19_RFL8_SIG16_NIR16"),
                      HasSubstr("/os/lidar_packets")));
  }
};

TEST_F(PacketScansTest, BagsAndMcapFilesOfBothDrivers) {
  const auto ros1 = Record(12, "ouster_ros/PacketMsg", WireWriter::Form::kRos1);
  ExpectSweeps(Write("a.bag", BagBytes(ros1, {"lz4"})));
  const auto ros2 = Record(12, "ouster_sensor_msgs/PacketMsg", WireWriter::Form::kCdr);
  ExpectSweeps(Write("a.mcap", McapBytes(ros2, {})));
  // Older drivers write a byte more.
  const auto older = Record(12, "ouster_ros/PacketMsg", WireWriter::Form::kRos1, true, "x");
  ExpectSweeps(Write("b.bag", BagBytes(older, {})));
}

TEST_F(PacketScansTest, MetadataBesideTheRecording) {
  const std::string path = Write(
      "a.bag", BagBytes(Record(12, "ouster_ros/PacketMsg", WireWriter::Form::kRos1, false), {}));
  const auto message = [&] { return MessageOf<InputError>([&] { OpenScans(path, {}); }); };
  EXPECT_THAT(message(), AllOf(HasSubstr("metadata.json"), HasSubstr("/os/lidar_packets")));
  Write("a.json", "{");
  EXPECT_THAT(message(), HasSubstr("a.json"));
  Write("a.json", OusterMetadataText(kProfile, 32, true));
  EXPECT_THAT(message(), HasSubstr("no packets of the sensor"));
  Write("a.json", OusterMetadataText(kProfile, kChannels, false));
  ExpectSweeps(path);
}

TEST_F(PacketScansTest, WhatIsNoPacketIsPassedOverAndCounted) {
  RecordedMessages recorded = Record(12, "ouster_ros/PacketMsg", WireWriter::Form::kRos1);
  for (const char* bytes : {"", "ab", "\x01\x00\x00\x00q"}) {
    recorded.messages.insert(recorded.messages.begin() + 9, {1, StampOf(2), bytes});
  }
  const auto scans = OpenScans(Write("a.bag", BagBytes(recorded, {})), {});
  EXPECT_EQ(scans->size(), 3U);
  EXPECT_THAT(scans->Describe().doubts, ElementsAre(HasSubstr("3 messages on /os/lidar_packets")));
}

TEST_F(PacketScansTest, CutAndDamagedRecordingsGiveErrorsOrFewerSweeps) {
  const std::string whole =
      BagBytes(Record(40, "ouster_ros/PacketMsg", WireWriter::Form::kRos1), {"none", 4, false});
  const auto read = [&](const std::string& bytes) -> std::size_t {
    try {
      const auto scans = OpenScans(Write("a.bag", bytes), {});
      for (std::size_t i = 0; i < scans->size(); ++i) {
        try {
          scans->Read(i);
        } catch (const InputError&) {
        }
      }
      return scans->size();
    } catch (const InputError&) {
      return 0;
    }
  };
  std::size_t before = 0;
  for (std::size_t cut = 0; cut <= 100; ++cut) {
    const std::size_t sweeps = read(whole.substr(0, whole.size() * cut / 100));
    EXPECT_GE(sweeps, before);
    before = sweeps;
  }
  EXPECT_EQ(before, 10U);
  std::mt19937 random(5);
  for (int i = 0; i < 200; ++i) {
    std::string damaged = whole;
    damaged[4096 + random() % (damaged.size() - 4096)] ^= static_cast<char>(1U << random() % 8);
    EXPECT_LE(read(damaged), 40U);
  }
}

// Of a sensor, recorded by its driver.
TEST_F(PacketScansTest, RealRecording) {
  const char* recordings = std::getenv("LAMINA_RECORDINGS");
  const std::string path =
      std::string(recordings == nullptr ? "" : recordings) + "/formats/ouster/512x10_raw.bag";
  if (!std::filesystem::exists(path)) GTEST_SKIP() << "LAMINA_RECORDINGS has no formats/ouster";
  const auto scans = OpenScans(path, {});
  ASSERT_EQ(scans->size(), 1U);
  EXPECT_THAT(scans->Read(0).points, SizeIs(28751));
  EXPECT_NEAR(static_cast<double>(scans->Stamp(0)) * 1e-9, 1723828414.28, 0.01);
}

}  // namespace
}  // namespace lamina
