#include "io/store/checkpoint_file.h"

#include <cstring>
#include <utility>

#include "tests/support/files/io_test_files.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;
using Sections = std::vector<std::pair<std::string, std::string>>;

const Sections kSections = {{"HEAD", "12345678"},
                            {"ROOT", std::string("\0\1\2\xff", 4)},
                            {"ROOT", ""},
                            {"END?", "looks like the end"}};

class CheckpointFileTest : public FilesTest {
 protected:
  std::string Make(const Sections& sections) const {
    CheckpointWriter writer(Path("a.lmap"));
    for (const auto& [tag, bytes] : sections) writer.Write(tag, bytes);
    writer.Commit();
    EXPECT_EQ(writer.bytes(), fs::file_size(Path("a.lmap")));
    return Bytes(Path("a.lmap"));
  }
  static Sections ReadAll(const std::string& path) {
    CheckpointReader reader(path);
    Sections sections;
    std::string tag, bytes;
    while (reader.Next(&tag, &bytes)) sections.emplace_back(tag, bytes);
    return sections;
  }
  // What() of the error that a file of these bytes gives; it must name the file.
  std::string ErrorOf(const std::string& bytes) const {
    const std::string path = Write("damaged.lmap", bytes);
    const std::string message = MessageOf<InputError>([&] { ReadAll(path); });
    EXPECT_THAT(message, HasSubstr(path));
    return message;
  }
  std::vector<std::string> FilesHere() const {
    std::vector<std::string> names;
    for (const auto& entry : fs::directory_iterator(folder_)) {
      names.push_back(entry.path().filename().string());
    }
    return names;
  }
};

TEST_F(CheckpointFileTest, SectionsComeBackInOrder) {
  Make(kSections);
  EXPECT_EQ(ReadAll(Path("a.lmap")), kSections);
}

TEST_F(CheckpointFileTest, AFileWithoutSectionsIsWhole) {
  Make({});
  EXPECT_TRUE(ReadAll(Path("a.lmap")).empty());
}

TEST_F(CheckpointFileTest, LargeSectionsComeBack) {
  std::string large(5000000, ' ');
  for (std::size_t i = 0; i < large.size(); ++i) large[i] = static_cast<char>(i * i >> 7U);
  Make({{"ROOT", large}, {"ROOT", large}});
  const Sections read = ReadAll(Path("a.lmap"));
  ASSERT_EQ(read.size(), 2U);
  EXPECT_TRUE(read[0].second == large && read[1].second == large);
}

TEST_F(CheckpointFileTest, TheLayoutIsThatOfTheHeader) {
  const std::string bytes = Make({{"HEAD", "abc"}});
  EXPECT_EQ(bytes.substr(0, 12), "LAMINAMP" + Pack(std::uint32_t{42}));
  EXPECT_EQ(bytes.substr(12, 4), "HEAD");
  // CRC-32 of "HEADabc", from another program (Python's zlib.crc32).
  EXPECT_EQ(bytes.substr(16, 4), Pack(std::uint32_t{0xe9d59fc}));
  EXPECT_EQ(bytes.substr(20, 11), Pack(std::uint64_t{3}) + "abc");
  EXPECT_EQ(bytes.substr(31, 4), "END ");
  EXPECT_EQ(bytes.substr(39), Pack(std::uint64_t{8}, std::uint64_t{1}));
}

TEST_F(CheckpointFileTest, EachByteChangedIsFound) {
  const std::string good = Make(kSections);
  for (std::size_t i = 0; i < good.size(); ++i) {
    for (const std::size_t bit : {i % 8, (i + 3) % 8}) {
      std::string bad = good;
      bad[i] = static_cast<char>(bad[i] ^ (1U << bit));
      ErrorOf(bad);
      ASSERT_FALSE(HasFailure()) << "byte " << i << ", bit " << bit;
    }
  }
}

TEST_F(CheckpointFileTest, EachTruncationIsFound) {
  const std::string good = Make(kSections);
  for (std::size_t size = 0; size < good.size(); ++size) {
    EXPECT_THAT(ErrorOf(good.substr(0, size)), HasSubstr("ends too early")) << size << " bytes";
  }
}

TEST_F(CheckpointFileTest, TrailingBytesAreFound) {
  const std::string good = Make(kSections);
  EXPECT_THAT(ErrorOf(good + '\0'), HasSubstr("damaged"));
  EXPECT_THAT(ErrorOf(good + good), HasSubstr("damaged"));
}

// Whole sections, each with its right checksum, that are missing or there twice.
TEST_F(CheckpointFileTest, MissingAndRepeatedSectionsAreFound) {
  const std::string good = Make(kSections);
  const std::size_t first = 12, second = first + 16 + 8, third = second + 16 + 4;
  EXPECT_THAT(ErrorOf(good.substr(0, second) + good.substr(third)), HasSubstr("missing"));
  EXPECT_THAT(ErrorOf(good.substr(0, third) + good.substr(second)), HasSubstr("missing"));
}

TEST_F(CheckpointFileTest, OtherVersionsAreNamed) {
  std::string bytes = Make(kSections);
  bytes[8] = 1;
  EXPECT_THAT(ErrorOf(bytes), AllOf(HasSubstr("version 1"), HasSubstr("version 42")));
}

TEST_F(CheckpointFileTest, OtherFilesAreRefused) {
  EXPECT_THAT(ErrorOf(std::string(1000, 'x')), HasSubstr("not a checkpoint"));
  EXPECT_THAT(ErrorOf("SQLite format 3"), HasSubstr("not a checkpoint"));
  EXPECT_THROW(CheckpointReader(Path("none.lmap")), InputError);
  EXPECT_THROW(CheckpointReader(folder_.string()), InputError);
}

TEST_F(CheckpointFileTest, WithoutCommitNothingIsLeft) {
  {
    CheckpointWriter writer(Path("a.lmap"));
    writer.Write("ROOT", std::string(100000, 'x'));
    EXPECT_FALSE(fs::exists(Path("a.lmap")));
  }
  EXPECT_TRUE(FilesHere().empty());
}

TEST_F(CheckpointFileTest, WithoutCommitAnOlderFileStays) {
  Make(kSections);
  { CheckpointWriter(Path("a.lmap")).Write("ROOT", "new"); }
  EXPECT_EQ(ReadAll(Path("a.lmap")), kSections);
  EXPECT_EQ(FilesHere(), std::vector<std::string>{"a.lmap"});
}

TEST_F(CheckpointFileTest, AFullDiskIsNamedAndAnOlderFileStays) {
  if (!fs::exists("/dev/full")) GTEST_SKIP() << "no /dev/full, the disk that is always full";
  for (const std::size_t bytes : {10U, 1000000U}) {
    Make(kSections);
    fs::create_symlink("/dev/full", Path("a.lmap.partial"));
    const std::string message = MessageOf<OutputError>([&] {
      CheckpointWriter writer(Path("a.lmap"));
      writer.Write("ROOT", std::string(bytes, 'x'));
      writer.Commit();
    });
    EXPECT_THAT(message, AllOf(HasSubstr(Path("a.lmap")), HasSubstr("No space left on device")));
    EXPECT_EQ(ReadAll(Path("a.lmap")), kSections);
    EXPECT_EQ(FilesHere(), std::vector<std::string>{"a.lmap"});
  }
}

TEST_F(CheckpointFileTest, AMissingFolderIsNamed) {
  EXPECT_THAT(MessageOf<OutputError>([&] { CheckpointWriter(Path("none/a.lmap")); }),
              HasSubstr("none/a.lmap"));
}

TEST_F(CheckpointFileTest, ATagHasFourCharacters) {
  CheckpointWriter writer(Path("a.lmap"));
  EXPECT_THROW(writer.Write("LONGER", ""), std::logic_error);
  EXPECT_THROW(writer.Write("", ""), std::logic_error);
}

}  // namespace
}  // namespace lamina
