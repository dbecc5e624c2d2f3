// Containers against the programs of those who defined them: what they write is read here, and what
// the other tests read, which tests/support/files/container_files.h writes, is read by them.
//
//   ROS 1 bags    Debian's python3-rosbag
//   MCAP          npm's @mcap/core and @mcap/support, see LAMINA_ORACLES in tests/README.md
#include <algorithm>
#include <string>
#include <tuple>
#include <vector>

#include "io/container/message_container.h"
#include "tests/support/files/container_files.h"
#include "tests/support/oracles.h"

namespace lamina {
namespace {

// As the scripts of tests/io/oracles exchange them.
std::string ListOf(const RecordedMessages& recorded, const std::string& between) {
  std::string list;
  for (const RecordedMessage& message : recorded.messages) {
    std::string type = recorded.topics[message.topic].type;
    type.replace(type.find('/'), 1, between);
    list += Pack(static_cast<std::uint64_t>(message.log_ns)) +
            Counted(recorded.topics[message.topic].name) + Counted(type) + Counted(message.bytes);
  }
  return list;
}

class ContainerOracleTest : public FilesTest {
 protected:
  ContainerOracleTest() {
    drive_.topics = {{"/imu", "sensor_msgs/Imu"}, {"/points", "sensor_msgs/PointCloud2"}};
    std::uint32_t random = 1;
    for (std::size_t i = 0; i < 40; ++i) {
      std::string bytes(i % 4 == 0 ? 2000 + 37 * i : 30, '\0');
      for (char& c : bytes) c = static_cast<char>((random = random * 1664525 + 1013904223) >> 28);
      drive_.messages.push_back({i % 4 == 0 ? 1U : 0U,
                                 1'700'000'000'123'456'789 + static_cast<StampNs>(i) * 25'000'001,
                                 bytes});
    }
  }
  // What is read here, in the order in which it was recorded.
  void ExpectDrive(const std::string& path) const {
    const auto container = OpenMessageContainer(path, [](const MessageTopic&) { return true; });
    EXPECT_THAT(container->doubts(), testing::IsEmpty());
    ASSERT_THAT(container->topics(), testing::SizeIs(2));
    std::vector<std::tuple<StampNs, std::string, std::string, std::string>> read, expected;
    for (std::size_t t = 0; t < 2; ++t) {
      const MessageTopic& topic = container->topics()[t];
      for (const MessagePlace& place : container->Messages(t)) {
        read.emplace_back(place.log_ns, topic.name, topic.type, container->Read(place));
      }
    }
    for (const RecordedMessage& message : drive_.messages) {
      const RecordedTopic& topic = drive_.topics[message.topic];
      expected.emplace_back(message.log_ns, topic.name, topic.type, message.bytes);
    }
    std::sort(read.begin(), read.end());
    EXPECT_TRUE(read == expected);
  }

  RecordedMessages drive_;
};

TEST_F(ContainerOracleTest, BagsOfRosAreReadAndOursAreReadByIt) {
  const std::string python = PythonWith("rosbag");
  if (python.empty()) GTEST_SKIP() << "no python3-rosbag (Debian) here";
  const std::string list = ListOf(drive_, "/");
  Write("list", list);
  for (const char* compression : {"none", "bz2", "lz4"}) {
    SCOPED_TRACE(compression);
    const std::string script = "rosbag_messages.py";
    ASSERT_TRUE(RunOracle(python, script, {"write", Path("list"), Path("a.bag"), compression}));
    ExpectDrive(Path("a.bag"));
    Write("b.bag", BagBytes(drive_, {compression, 7, true}));
    ASSERT_TRUE(RunOracle(python, script, {"read", Path("b.bag"), Path("read")}));
    EXPECT_TRUE(Bytes(Path("read")) == list);
  }
}

TEST_F(ContainerOracleTest, McapFilesOfItsLibraryAreReadAndOursAreReadByIt) {
  const std::string node = NodeWithOracles();
  if (node.empty()) GTEST_SKIP() << "LAMINA_ORACLES is unset: no @mcap/core";
  const std::string list = ListOf(drive_, "/msg/"), script = "mcap_messages.cjs";
  Write("list", list);
  for (const char* compression : {"none", "zstd"}) {
    SCOPED_TRACE(compression);
    ASSERT_TRUE(
        RunOracle(node, script, {"write", Path("list"), Path("a.mcap"), compression, "chunks"}));
    ExpectDrive(Path("a.mcap"));
  }
  for (const char* compression : {"", "lz4", "zstd"}) {
    for (const char* how : {"index", "stream"}) {
      SCOPED_TRACE(std::string(compression) + how);
      Write("b.mcap", McapBytes(drive_, {compression, 7, true, true, false}));
      ASSERT_TRUE(RunOracle(node, script, {"read", Path("b.mcap"), Path("read"), how}));
      EXPECT_TRUE(Bytes(Path("read")) == list);
    }
  }
}

}  // namespace
}  // namespace lamina
