// Each kind of container gives back the messages that it was written with, whatever of its index is
// there.
#include "io/container/message_container.h"

#include <filesystem>
#include <fstream>

#include "tests/io/container/container_fixture.h"

namespace lamina {
namespace {

using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

// Bytes that this process has asked the system for so far.
std::size_t BytesRead() {
  std::ifstream status("/proc/self/io");
  for (std::string word; status >> word;) {
    std::size_t value = 0;
    if (word == "rchar:" && status >> value) return value;
  }
  return 0;
}

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

}  // namespace
}  // namespace lamina
