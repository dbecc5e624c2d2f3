// Each kind of container gives back the messages that it was written with, whatever of its index is
// there; what is damaged or made to do harm is refused, or passed over with a line that says so.
#include "io/container/message_container.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <functional>

#include "tests/support/files/container_files.h"
#include "tests/support/peak_memory.h"

namespace lamina {
namespace {

using testing::AnyOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

bool IsCloud(const MessageTopic& topic) { return topic.type == "sensor_msgs/PointCloud2"; }

// Bytes that this process has asked the system for so far.
std::size_t BytesRead() {
  std::ifstream status("/proc/self/io");
  for (std::string word; status >> word;) {
    std::size_t value = 0;
    if (word == "rchar:" && status >> value) return value;
  }
  return 0;
}

// Clouds on one topic, beside many small messages on another. Bytes do not repeat.
RecordedMessages Drive(std::size_t clouds, std::size_t cloud_bytes = 3000) {
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

std::vector<std::string> CloudsOf(const RecordedMessages& drive) {
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
    ASSERT_THAT(topics, SizeIs(2));
    const std::size_t cloud = CloudTopic(*container);
    EXPECT_EQ(topics[cloud].messages, CloudsOf(drive).size());
    EXPECT_EQ(topics[1 - cloud].messages, 4 * CloudsOf(drive).size());
    EXPECT_EQ(topics[1 - cloud].type, "sensor_msgs/Imu");
    EXPECT_THAT(container->Messages(1 - cloud), IsEmpty());
    const MessagePlace& second = container->Messages(cloud).at(1);
    EXPECT_EQ(second.log_ns, 150);
    EXPECT_TRUE(container->Read(second, 5) == CloudsOf(drive)[1].substr(0, 5));
  }
};

TEST_F(ContainerTest, Ros1BagsOfEveryCompression) {
  const RecordedMessages drive = Drive(7);
  for (const char* compression : {"none", "bz2", "lz4"}) {
    for (const bool closed : {true, false}) {
      const std::string path = Write("a.bag", BagBytes(drive, {compression, 3, closed}));
      ExpectDrive(path, drive);
      EXPECT_THAT(OpenMessageContainer(path, IsCloud)->doubts(), SizeIs(closed ? 0 : 1));
    }
  }
}

TEST_F(ContainerTest, McapOfEveryCompressionWithAndWithoutIndex) {
  const RecordedMessages drive = Drive(7);
  for (const char* compression : {"", "lz4", "zstd"}) {
    for (const bool summary : {true, false}) {
      for (const std::size_t a_chunk : {0, 1, 3, 100}) {
        const std::string path =
            Write("a.mcap", McapBytes(drive, {compression, a_chunk, summary, true, false}));
        ExpectDrive(path, drive);
        EXPECT_THAT(OpenMessageContainer(path, IsCloud)->doubts(),
                    SizeIs(summary && a_chunk > 0 ? 0 : 1));
      }
    }
  }
}

TEST_F(ContainerTest, Ros2BagsPlainAndCompressedAndSplit) {
  const RecordedMessages drive = Drive(6);
  WriteDatabase(Path("a.db3"), drive);
  ExpectDrive(Path("a.db3"), drive);
  WriteDatabase(Path("messages.db3"), drive, true);
  ExpectDrive(Path("messages.db3"), drive);

  RecordedMessages packed = drive;
  for (RecordedMessage& message : packed.messages) {
    message.bytes = Compressed(message.bytes, "zstd");
  }
  ExpectDrive(Write("messages.mcap", McapBytes(packed, {"", 3, true, true, false})), drive);

  RecordedMessages first = drive, second = drive;
  first.messages.resize(15);
  second.messages.erase(second.messages.begin(), second.messages.begin() + 15);
  std::filesystem::create_directories(Path("split"));
  WriteDatabase(Path("split/s_0.db3"), first);
  WriteDatabase(Path("split/s_1.db3"), second);
  ExpectDrive(Path("split"), drive);
  Write("split/metadata.yaml", Metadata({"s_1.db3", "s_0.db3"}));
  ExpectDrive(Path("split"), drive);

  Write("packed/s_0.db3.zstd", Compressed(Bytes(Path("split/s_0.db3")), "zstd"));
  Write("packed/s_1.db3.zstd", Compressed(Bytes(Path("split/s_1.db3")), "zstd"));
  Write("packed/metadata.yaml", Metadata({"s_0.db3.zstd", "\"s_1.db3.zstd\""}));
  ExpectDrive(Path("packed"), drive);
  ExpectDrive(Write("all.mcap.zstd", Compressed(McapBytes(drive, {}), "zstd")), drive);

  Write("split/metadata.yaml", Metadata({"s_0.db3", "s_1.db3", "s_2.db3"}));
  EXPECT_THAT(OpenMessageContainer(Path("split"), IsCloud)->doubts(),
              ElementsAre(AllOf(HasSubstr("s_2.db3"), HasSubstr("left out"))));
}

// A recording of 100 GB is opened in the time that its index takes.
TEST_F(ContainerTest, WithAnIndexNoMoreThanThatIsRead) {
  if (BytesRead() == 0) GTEST_SKIP() << "/proc/self/io cannot be read";
  const RecordedMessages drive = Drive(100, 100'000);
  std::vector<std::string> paths;
  for (const char* compression : {"none", "lz4", "bz2"}) {
    paths.push_back(
        Write(std::string(compression) + ".bag", BagBytes(drive, {compression, 5, true})));
  }
  for (const char* compression : {"", "lz4", "zstd"}) {
    McapOptions options;
    options.compression = compression;
    paths.push_back(Write(std::string("a") + compression + ".mcap", McapBytes(drive, options)));
  }
  paths.push_back(Path("a.db3"));
  WriteDatabase(paths.back(), drive);
  for (const std::string& path : paths) {
    SCOPED_TRACE(path);
    const std::size_t whole = std::filesystem::file_size(path), before = BytesRead();
    const auto container = OpenMessageContainer(path, IsCloud);
    EXPECT_LT(BytesRead() - before, whole / 10);
    const std::vector<MessagePlace>& places = container->Messages(CloudTopic(*container));
    ASSERT_THAT(places, SizeIs(100));
    container->Read(places[50]);
    EXPECT_LT(BytesRead() - before, whole / 5) << "and of the rest what one message needs";
    EXPECT_THAT(container->doubts(), IsEmpty());
  }
}

// Bytes in a chunk in memory, in one that is read piece by piece, and in a database.
TEST_F(ContainerTest, MessagesInPlaceAreTheOnesThatAreRead) {
  const RecordedMessages drive = Drive(10);
  const auto expect = [&](const std::string& path) {
    SCOPED_TRACE(path);
    const auto container = OpenMessageContainer(path, IsCloud);
    for (const MessagePlace& place : container->Messages(CloudTopic(*container))) {
      std::string there;
      container->With(place, [&](std::string_view bytes) { there = bytes; });
      EXPECT_TRUE(there == container->Read(place));
      EXPECT_TRUE(container->Read(place, 7) == there.substr(0, 7));
      EXPECT_THROW(container->With(place, [](std::string_view) { throw InputError("mine"); }),
                   InputError);
    }
  };
  for (const char* compression : {"none", "bz2"}) {
    expect(Write("a.bag", BagBytes(drive, {compression})));
  }
  for (const char* compression : {"", "zstd"}) {
    McapOptions options;
    options.compression = compression;
    expect(Write("a.mcap", McapBytes(drive, options)));
  }
  for (const bool packed : {false, true}) {
    const std::string path = Path(packed ? "b.db3" : "a.db3");
    WriteDatabase(path, drive, packed);
    expect(path);
  }
}

TEST_F(ContainerTest, ADamagedIndexIsNotBelieved) {
  const RecordedMessages drive = Drive(7);
  std::string mcap = McapBytes(drive, {});
  mcap[mcap.size() - 60] = static_cast<char>(mcap[mcap.size() - 60] ^ 1);
  ExpectDrive(Write("a.mcap", mcap), drive);
  std::string bag = BagBytes(drive, {"lz4", 3, true});
  const std::size_t place = bag.rfind("chunk_pos=");
  bag[place + 10] = static_cast<char>(bag[place + 10] ^ 4);
  ExpectDrive(Write("a.bag", bag), drive);
  EXPECT_THAT(OpenMessageContainer(Path("a.bag"), IsCloud)->doubts(),
              ElementsAre(HasSubstr("the index cannot be used")));
}

TEST_F(ContainerTest, ADamagedChunkCostsItsMessages) {
  const RecordedMessages drive = Drive(9, 20000);
  for (const std::string compression : {"", "lz4", "zstd"}) {
    for (const bool summary : {true, false}) {
      std::string bytes = McapBytes(drive, {compression, 5, summary, true, false});
      bytes[bytes.size() / 2] = static_cast<char>(bytes[bytes.size() / 2] ^ 16);
      const auto container = OpenMessageContainer(Write("a.mcap", bytes), IsCloud);
      std::size_t read = 0, refused = 0;
      for (const MessagePlace& place : container->Messages(CloudTopic(*container))) {
        try {
          container->Read(place);
          ++read;
        } catch (const InputError& error) {
          EXPECT_THAT(error.what(), AnyOf(HasSubstr("checksum"), HasSubstr("unpacked")));
          ++refused;
        }
      }
      EXPECT_EQ(read, 8U) << compression;
      EXPECT_EQ(refused, summary ? 1U : 0U);
      EXPECT_THAT(container->doubts(), SizeIs(summary ? 0 : 1));
    }
  }
}

TEST_F(ContainerTest, OfACutFileThereIsWhatIsBeforeTheCut) {
  const RecordedMessages drive = Drive(20);
  WriteDatabase(Path("whole.db3"), drive);
  const std::vector<std::pair<std::string, std::string>> files = {
      {"cut.bag", BagBytes(drive, {"lz4", 3, true})},
      {"cut.bag", BagBytes(drive, {"none", 3, true})},
      {"cut.mcap", McapBytes(drive, {})},
      {"cut.mcap", McapBytes(drive, {"", 0, true, true, false})},
      {"cut.db3", Bytes(Path("whole.db3"))}};
  const std::vector<std::string> all = CloudsOf(drive);
  for (const auto& [name, bytes] : files) {
    std::size_t before = 0;
    for (std::size_t cut = 1; cut <= 100; ++cut) {
      const std::string path = WriteAnew(name, bytes.substr(0, bytes.size() * cut / 101));
      try {
        const auto container = OpenMessageContainer(path, IsCloud);
        EXPECT_THAT(container->doubts(), testing::Not(IsEmpty()));
        if (container->topics().empty()) continue;
        std::size_t read = 0, i = 0;
        for (const MessagePlace& place : container->Messages(CloudTopic(*container))) {
          try {
            EXPECT_TRUE(container->Read(place) == all.at(i++)) << path << " " << cut;
            ++read;
          } catch (const InputError&) {
            // Of a cut database the rows may be there, and not what they hold.
          }
        }
        EXPECT_GE(read + 3, before) << name << " cut at " << cut << " %";
        before = read;
      } catch (const InputError& error) {
        EXPECT_THAT(error.what(), HasSubstr(path));
        EXPECT_TRUE(before == 0 || name == "cut.db3") << error.what();
      }
    }
    EXPECT_GE(before, name == "cut.db3" ? 0U : 17U) << name;
  }
}

TEST_F(ContainerTest, FlippedBitsGiveErrorsAndNoCrash) {
  const RecordedMessages drive = Drive(4, 300);
  WriteDatabase(Path("whole.db3"), drive);
  const std::vector<std::pair<std::string, std::string>> files = {
      {"a.bag", BagBytes(drive, {"none", 3, true})},
      {"a.bag", BagBytes(drive, {"bz2", 3, false})},
      {"a.bag", BagBytes(drive, {"lz4", 3, true})},
      {"a.mcap", McapBytes(drive, {})},
      {"a.mcap", McapBytes(drive, {"lz4", 3, false, false, false})},
      {"a.mcap", McapBytes(drive, {"", 0, true, true, false})},
      {"a.db3", Bytes(Path("whole.db3"))}};
  std::uint32_t random = 7;
  for (const auto& [name, bytes] : files) {
    // Half of them in the last kilobyte or the first, where the index and the header are.
    for (int trial = 0; trial < 150; ++trial) {
      std::string damaged = bytes;
      random = random * 1664525 + 1013904223;
      const std::size_t within = std::min<std::size_t>(bytes.size(), 1024);
      std::size_t at = (random >> 8) % bytes.size();
      if (trial % 4 == 0) at = bytes.size() - 1 - (random >> 8) % within;
      if (trial % 4 == 1) at = (random >> 8) % within;
      damaged[at] = static_cast<char>(damaged[at] ^ (1 << (random >> 29)));
      try {
        const auto container = OpenMessageContainer(WriteAnew(name, damaged), IsCloud);
        for (std::size_t t = 0; t < container->topics().size(); ++t) {
          for (const MessagePlace& place : container->Messages(t)) {
            try {
              container->Read(place);
            } catch (const InputError&) {
            }
          }
        }
      } catch (const InputError& error) {
        EXPECT_THAT(error.what(), HasSubstr(name));
      }
    }
  }
}

// Opens and reads all, and expects that it takes no more than 64 MB.
void ExpectBounded(const std::string& path, const std::string& complaint) {
  SCOPED_TRACE(path);
  const ExpectBoundedMemory bounded;
  std::string said;
  try {
    const auto container = OpenMessageContainer(path, IsCloud);
    for (const std::string& doubt : container->doubts()) said += doubt + "\n";
    for (std::size_t t = 0; t < container->topics().size(); ++t) {
      for (const MessagePlace& place : container->Messages(t)) container->Read(place, 100);
    }
  } catch (const InputError& error) {
    said += error.what();
  }
  EXPECT_THAT(said, HasSubstr(complaint)) << path;
}

TEST_F(ContainerTest, LengthsBeyondTheFileAreRefused) {
  const std::string magic("\x89MCAP0\r\n", 8);
  const std::string header = magic + McapRecord(1, Counted("") + Counted(""));
  const std::uint64_t huge = UINT64_MAX - 10;
  ExpectBounded(Write("a.mcap", header + Op(6) + Pack(huge)), "impossible length");
  ExpectBounded(Write("a.mcap", header + Op(5) + Pack(std::uint64_t{1} << 40)), "the file ends");
  ExpectBounded(Write("a.mcap", header + McapRecord(3, Pack(std::uint16_t{1}, 0xFFFFFFFFU))),
                "must be at most");
  // A chunk that says that it has 2^60 bytes when unpacked.
  const std::string packed = Compressed("abc", "zstd");
  const std::string chunk = Pack(std::uint64_t{0}, std::uint64_t{0}, std::uint64_t{1} << 60, 0U) +
                            Counted("zstd") + Pack(static_cast<std::uint64_t>(packed.size())) +
                            packed;
  ExpectBounded(Write("a.mcap", header + McapRecord(6, chunk)), "cannot have");
  ExpectBounded(Write("a.bag", "#ROSBAG V2.0\n" + Pack(0xFFFFFFFFU)), "must be at most");
  ExpectBounded(Write("a.bag", "#ROSBAG V2.0\n" + Pack(16U, 0xFFFFFFF0U) + std::string(40, ' ')),
                "name=value");
  ExpectBounded(Write("a.bag", "#ROSBAG V1.2\n"), "version");
  ExpectBounded(Write("a.bag", ""), "begins like no");
}

TEST_F(ContainerTest, BombsTakeNoMemory) {
  const std::string magic("\x89MCAP0\r\n", 8);
  const std::string header = magic + McapRecord(1, Counted("") + Counted(""));
  const std::string channel =
      McapRecord(3, Pack(std::uint16_t{1}) + Counted("sensor_msgs/msg/PointCloud2") + Counted("") +
                        Counted("")) +
      McapRecord(4, Pack(std::uint16_t{1}, std::uint16_t{1}) + Counted("/points") + Counted("cdr") +
                        Counted(""));
  const auto bomb = [&](const std::string& bytes, const char* compression) {
    const std::string packed = Compressed(bytes, compression);
    return header + McapRecord(6, Pack(std::uint64_t{0}, std::uint64_t{0},
                                       static_cast<std::uint64_t>(bytes.size()), 0U) +
                                      Counted(compression) +
                                      Pack(static_cast<std::uint64_t>(packed.size())) + packed);
  };
  const std::size_t kBytes = 150 << 20;
  {
    std::string zeros = channel + McapRecord(5, std::string(kBytes, '\0'));
    Write("zstd.mcap", bomb(zeros, "zstd"));
    Write("lz4.mcap", bomb(zeros, "lz4"));
    Write("bomb.db3.zstd", Compressed("SQLite format 3" + zeros, "zstd"));
  }
  ExpectBounded(Path("zstd.mcap"), "cannot have");
  ExpectBounded(Path("lz4.mcap"), "");
  ExpectBounded(Path("bomb.db3.zstd"), "refused");
}

TEST_F(ContainerTest, ChunksTooLargeToBeKeptAreReadPieceByPiece) {
  const RecordedMessages drive = Drive(3, 9 << 20);
  for (const bool summary : {true, false}) {
    std::string bytes = McapBytes(drive, {"lz4", 100, summary, true, false});
    ExpectDrive(Write("a.mcap", bytes), drive);
    bytes[bytes.size() / 2] = static_cast<char>(bytes[bytes.size() / 2] ^ 1);
    const auto container = OpenMessageContainer(Write("a.mcap", bytes), IsCloud);
    if (!summary) {
      EXPECT_THAT(container->doubts(), testing::Contains(HasSubstr("checksum")));
      continue;
    }
    const MessagePlace& place = container->Messages(CloudTopic(*container)).at(0);
    EXPECT_THAT(MessageOf<InputError>([&] { container->Read(place, 10); }), HasSubstr("checksum"));
  }
  ExpectDrive(Write("a.bag", BagBytes(drive, {"lz4", 100, true})), drive);
}

TEST_F(ContainerTest, NoMoreThanAMillionMessages) {
  RecordedMessages drive;
  drive.topics = {{"/points", "sensor_msgs/PointCloud2"}};
  drive.messages.resize(kMostMessages + 5, {0, 5, ""});
  Write("many.mcap", McapBytes(drive, {"lz4", 500'000, false, true, false}));
  drive = {};
  const auto container = OpenMessageContainer(Path("many.mcap"), IsCloud);
  EXPECT_THAT(container->Messages(0), SizeIs(kMostMessages));
  EXPECT_THAT(container->doubts(), testing::Contains(HasSubstr("the last 5 messages")));
}

TEST_F(ContainerTest, WhatIsNoneIsSaidToBeNone) {
  EXPECT_FALSE(IsMessageContainer(Write("a.pcd", "VERSION")));
  EXPECT_FALSE(IsMessageContainer(Path("")));
  EXPECT_TRUE(IsMessageContainer(Write("a.bag.active", "#ROSBAG V2.0\n")));
  EXPECT_TRUE(IsMessageContainer(Write("wrong.mcap", "text")));
  EXPECT_THAT(MessageOf<InputError>([&] { OpenMessageContainer(Path("wrong.mcap"), IsCloud); }),
              HasSubstr("begins like no"));
  EXPECT_THAT(MessageOf<InputError>([&] { OpenMessageContainer(Path("none.bag"), IsCloud); }),
              HasSubstr("No such file"));
  SQLite::Database(Path("other.db3"), SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE)
      .exec("CREATE TABLE t(a)");
  EXPECT_THAT(MessageOf<InputError>([&] { OpenMessageContainer(Path("other.db3"), IsCloud); }),
              HasSubstr("no ROS 2 bag"));
}

}  // namespace
}  // namespace lamina
