#include "io/store/byte_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "tests/support/files/io_test_files.h"

namespace lamina {
namespace {

class ByteFileTest : public FilesTest {
 protected:
  static std::string Of(const ByteFile& file, const StoredBytes& place) {
    std::string bytes(place.size, '\0');
    return file.Read(place, bytes.data()) ? bytes : "damaged";
  }
};

TEST_F(ByteFileTest, WhatWasAppendedIsReadAgainAlsoByTheNextProcess) {
  StoredBytes first, second;
  {
    ByteFile file(Path("bytes"), ByteFile::Lifetime::kKept);
    first = *file.Append("one");
    second = *file.Append("and two");
    file.SyncToDisk();
    EXPECT_EQ(Of(file, first), "one");
  }
  ByteFile again(Path("bytes"), ByteFile::Lifetime::kKept);
  EXPECT_EQ(again.size(), 10U);
  EXPECT_EQ(Of(again, second), "and two");
  again.RollBackTo(3);
  EXPECT_EQ(Of(again, second), "damaged");
  EXPECT_EQ(again.Append("and 2!!")->at, second.at);
  EXPECT_EQ(Of(again, second), "damaged");
  EXPECT_THROW(again.RollBackTo(100), InputError);
}

TEST_F(ByteFileTest, AReaderLeavesAllAsItIs) {
  EXPECT_EQ(ByteFile(Path("none"), ByteFile::Lifetime::kReadOnly).size(), 0U);
  StoredBytes place;
  {
    ByteFile file(Path("bytes"), ByteFile::Lifetime::kKept);
    place = *file.Append("something");
    file.Append("more");
  }
  ByteFile reader(Path("bytes"), ByteFile::Lifetime::kReadOnly);
  EXPECT_FALSE(reader.Append("else"));
  reader.RollBackTo(9);
  EXPECT_EQ(Of(reader, place), "something");
  EXPECT_EQ(std::filesystem::file_size(Path("bytes")), 13U);
  EXPECT_FALSE(std::filesystem::exists(Path("none")));
}

TEST_F(ByteFileTest, WhatIsNotKeptGivesItsRoomBackAndTheRestStaysInPlace) {
  constexpr std::size_t kBytes = 1 << 20;
  ByteFile file(Path("bytes"), ByteFile::Lifetime::kKept);
  std::vector<StoredBytes> places;
  for (const char c : {'a', 'b', 'c', 'd'}) places.push_back(*file.Append(std::string(kBytes, c)));
  const auto blocks = [&] {
    struct stat status {};
    EXPECT_EQ(stat(Path("bytes").c_str(), &status), 0);
    return static_cast<std::size_t>(status.st_blocks) * 512;
  };
  file.SyncToDisk();
  const std::size_t before = blocks();
  file.KeepOnly({places[3], places[1]});
  EXPECT_EQ(Of(file, places[1]), std::string(kBytes, 'b'));
  EXPECT_EQ(Of(file, places[3]), std::string(kBytes, 'd'));
  EXPECT_EQ(file.size(), 4 * kBytes);
  const StoredBytes next = *file.Append("next");
  EXPECT_EQ(next.at, 4 * kBytes);
  // What comes after all of these is not theirs to say.
  file.KeepOnly({places[1]});
  EXPECT_EQ(Of(file, next), "next");
  if (Of(file, places[0]) != "damaged") GTEST_SKIP() << "files have no holes on this file system";
  EXPECT_LE(blocks() + 2 * kBytes, before + 16384);
}

TEST_F(ByteFileTest, DamageIsFound) {
  ByteFile file(Path("bytes"), ByteFile::Lifetime::kKept);
  const StoredBytes place = *file.Append("bytes");
  EXPECT_EQ(Of(file, place), "bytes");
  std::fstream(Path("bytes"), std::ios::in | std::ios::out).write("B", 1);
  EXPECT_EQ(Of(file, place), "damaged");
}

// Not even a process that is killed leaves it behind.
TEST_F(ByteFileTest, AScratchFileHasNoName) {
  ByteFile scratch(Path("scratch"), ByteFile::Lifetime::kScratch);
  const StoredBytes first = *scratch.Append("bytes"), second = *scratch.Append("more");
  EXPECT_FALSE(std::filesystem::exists(Path("scratch")));
  EXPECT_EQ(Of(scratch, first), "bytes");
  EXPECT_EQ(Of(scratch, second), "more");
  scratch.RollBackTo(first.size);
  EXPECT_EQ(Of(scratch, second), "damaged");
}

}  // namespace
}  // namespace lamina
