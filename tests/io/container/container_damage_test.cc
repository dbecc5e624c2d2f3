// What is damaged or made to do harm is refused, or passed over with a line that says so.
#include <algorithm>

#include "tests/io/container/container_fixture.h"
#include "tests/support/peak_memory.h"

namespace lamina {
namespace {

using testing::AnyOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

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
    // A database keeps its rows in no order that a cut would leave.
    if (name == "cut.db3") continue;
    EXPECT_GE(before, 17U) << name;
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
