// Containers of clouds beside other messages.
#pragma once

#include <gmock/gmock.h>

#include <algorithm>
#include <string>
#include <vector>

#include "io/container/message_container.h"
#include "tests/support/files/container_files.h"

namespace lamina {

inline bool IsCloud(const MessageTopic& topic) { return topic.type == "sensor_msgs/PointCloud2"; }

// Clouds on one topic, beside many small messages on another. Bytes do not repeat.
inline RecordedMessages Drive(std::size_t clouds, std::size_t cloud_bytes = 3000) {
  RecordedMessages drive;
  drive.topics = {{"/imu", "sensor_msgs/Imu"}, {"/points", "sensor_msgs/PointCloud2"}};
  std::uint32_t random = 1;
  for (std::size_t i = 0; i < clouds; ++i) {
    for (int k = 0; k < 4; ++k) {
      drive.messages.push_back({0, static_cast<StampNs>(100 * i + 10 * k), "imu"});
    }
    std::string bytes(cloud_bytes + i, '\0');
    for (char& c : bytes) c = static_cast<char>((random = random * 1664525 + 1013904223) >> 24);
    drive.messages.push_back({1, static_cast<StampNs>(100 * i + 50), bytes});
  }
  return drive;
}

inline std::vector<std::string> CloudsOf(const RecordedMessages& drive) {
  std::vector<std::string> clouds;
  for (const RecordedMessage& message : drive.messages) {
    if (message.topic == 1) clouds.push_back(message.bytes);
  }
  return clouds;
}

class ContainerTest : public FilesTest {
 protected:
  static std::size_t CloudTopic(const MessageContainer& container) {
    const auto& topics = container.topics();
    const auto found = std::find_if(topics.begin(), topics.end(), IsCloud);
    EXPECT_NE(found, topics.end());
    return static_cast<std::size_t>(found - topics.begin());
  }
  static std::vector<std::string> ReadClouds(const MessageContainer& container) {
    std::vector<std::string> clouds;
    for (const MessagePlace& place : container.Messages(CloudTopic(container))) {
      clouds.push_back(container.Read(place));
    }
    return clouds;
  }
  void ExpectDrive(const std::string& path, const RecordedMessages& drive) const {
    SCOPED_TRACE(path);
    const auto container = OpenMessageContainer(path, IsCloud);
    // Bytes that tell nothing when they are printed.
    EXPECT_TRUE(ReadClouds(*container) == CloudsOf(drive));
    const auto& topics = container->topics();
    ASSERT_THAT(topics, testing::SizeIs(2));
    const std::size_t cloud = CloudTopic(*container);
    EXPECT_EQ(topics[cloud].messages, CloudsOf(drive).size());
    EXPECT_EQ(topics[1 - cloud].messages, 4 * CloudsOf(drive).size());
    EXPECT_EQ(topics[1 - cloud].type, "sensor_msgs/Imu");
    EXPECT_THAT(container->Messages(1 - cloud), testing::IsEmpty());
    const MessagePlace& second = container->Messages(cloud).at(1);
    EXPECT_EQ(second.log_ns, 150);
    EXPECT_TRUE(container->Read(second, 5) == CloudsOf(drive)[1].substr(0, 5));
  }
};

}  // namespace lamina
