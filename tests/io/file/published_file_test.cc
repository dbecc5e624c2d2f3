#include "io/file/published_file.h"

#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>

#include "tests/support/files/file_size_limit.h"
#include "tests/support/files/io_test_files.h"
#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

class PublishedFileTest : public FilesTest {
 protected:
  std::string File() const { return Path("a.txt"); }
  std::string Shown() const { return Bytes(File()); }
};

TEST_F(PublishedFileTest, ShowsWhatWasAppendedAndTheLastTail) {
  Write("a.txt", "of an earlier run");
  PublishedFile file(File());
  file.Append("one\n");
  EXPECT_EQ(Shown(), "of an earlier run");
  file.Publish("open\n");
  EXPECT_EQ(Shown(), "one\nopen\n");
  file.Publish("open, and longer\n");
  EXPECT_EQ(Shown(), "one\nopen, and longer\n");
  file.Append("two\n");
  file.Append("three\n");
  file.Publish("");
  EXPECT_EQ(Shown(), "one\ntwo\nthree\n");
  file.Publish("x");
  EXPECT_EQ(Shown(), "one\ntwo\nthree\nx");
}

TEST_F(PublishedFileTest, IsThereFromTheFirstPublicationOnAndAloneAtTheEnd) {
  {
    PublishedFile file(File());
    file.Append("one");
    EXPECT_FALSE(fs::exists(File()));
    file.Publish(" tail");
    file.Append("two");
  }
  EXPECT_EQ(Shown(), "one tail");
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_), fs::directory_iterator()), 1);
}

TEST_F(PublishedFileTest, IsWhatItShouldBeWhateverTheSizes) {
  Draws draws(1);
  PublishedFile file(File());
  std::string stays;
  const auto some = [&](int most) {
    return std::string(static_cast<std::size_t>(draws.Integer(0, most)),
                       static_cast<char>(draws.Integer('a', 'z')));
  };
  for (int i = 0; i < 100; ++i) {
    for (int k = draws.Integer(0, 3); k > 0; --k) {
      const std::string bytes = some(draws.Integer(0, 19) == 0 ? 1500000 : 300);
      stays += bytes;
      file.Append(bytes);
    }
    const std::string tail = some(500);
    file.Publish(tail);
    if (i % 20 != 0) continue;
    ASSERT_TRUE(Shown() == stays + tail) << "publication " << i;
  }
  file.Publish("end");
  EXPECT_TRUE(Shown() == stays + "end");
}

TEST_F(PublishedFileTest, APublicationWritesWhatIsNewHoweverLongTheFileIs) {
  PublishedFile file(File());
  file.Append(std::string(10000000, 's'));
  file.Publish("tail");
  file.Publish("tail");
  const std::uint64_t before = BytesWritten();
  for (int i = 0; i < 10; ++i) {
    file.Append(std::string(100, 'n'));
    file.Publish(std::string(1000, 't'));
  }
  EXPECT_LT(BytesWritten() - before, 15000U);
  EXPECT_EQ(Shown().size(), 10002000U);
}

// A process that publishes numbers, a line each, those that are open with a mark, until it is
// ended.
TEST_F(PublishedFileTest, IsWholeWheneverTheProcessIsKilled) {
  Draws draws(5);
  for (int round = 0; round < 25; ++round) {
    const pid_t child = fork();
    if (child == 0) {
      PublishedFile file(File());
      for (int next = 0;; next += 500) {
        std::string lines, open;
        for (int i = next; i < next + 500; ++i) lines += std::to_string(i) + "\n";
        for (int i = next + 500; i < next + 900; ++i) open += std::to_string(i) + " open\n";
        file.Append(lines);
        file.Publish(open);
      }
    }
    usleep(static_cast<useconds_t>(draws.Integer(5000, 60000)));
    kill(child, SIGKILL);
    waitpid(child, nullptr, 0);
    std::ifstream lines(File());
    int expected = 0;
    bool open = false;
    for (std::string line; std::getline(lines, line); ++expected) {
      open = open || line.find(" open") != std::string::npos;
      ASSERT_EQ(line, std::to_string(expected) + (open ? " open" : ""));
    }
    ASSERT_EQ(expected % 500, expected == 0 ? 0 : 400) << "round " << round;
  }
}

// A reader that has it open may read on until the publication after the next.
TEST_F(PublishedFileTest, AReaderSeesTheFileThatItOpened) {
  PublishedFile file(File());
  file.Append("one ");
  file.Publish("open");
  file.Publish("open");
  std::ifstream reader(File());
  file.Append("two ");
  file.Publish("");
  std::string read;
  std::getline(reader, read);
  EXPECT_EQ(read, "one open");
}

TEST_F(PublishedFileTest, FilesThatAreTakenAwayOrReplacedAreMadeAgain) {
  PublishedFile file(File());
  file.Append("one ");
  file.Publish("");
  file.Publish("");
  fs::remove(File());
  file.Append("two ");
  file.Publish("tail");
  EXPECT_EQ(Shown(), "one two tail");
  file.Publish("tail");
  Write("other.txt", "another file");
  fs::rename(Path("other.txt"), File());
  for (const char* tail : {"a", "b", "c"}) {
    file.Append("more ");
    file.Publish(tail);
  }
  EXPECT_EQ(Shown(), "one two more more more c");
}

TEST_F(PublishedFileTest, WhatDoesNotFitHasNoEffectAndMayBeDoneAgain) {
  PublishedFile file(File());
  file.Append(std::string(1000, 'a'));
  file.Publish("tail");
  {
    const FileSizeLimit limit(3000);
    EXPECT_THAT(MessageOf<OutputError>([&] { file.Append(std::string(5000, 'b')); }),
                testing::HasSubstr(File()));
    EXPECT_THROW(file.Publish(std::string(5000, 't')), OutputError);
    EXPECT_EQ(Shown(), std::string(1000, 'a') + "tail");
  }
  file.Append(std::string(5000, 'b'));
  file.Publish("new tail");
  EXPECT_EQ(Shown(), std::string(1000, 'a') + std::string(5000, 'b') + "new tail");
}

TEST_F(PublishedFileTest, AFolderThatIsMissingIsNamed) {
  PublishedFile file(Path("none/a.txt"));
  EXPECT_THAT(MessageOf<OutputError>([&] { file.Publish(""); }),
              testing::HasSubstr("none/a.txt: cannot be created"));
}

}  // namespace
}  // namespace lamina
