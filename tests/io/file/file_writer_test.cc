#include "io/file/file_writer.h"

#include <unistd.h>

#include <stdexcept>

#include "io/file/disk_room.h"
#include "tests/support/files/file_size_limit.h"
#include "tests/support/files/io_test_files.h"
#include "tests/support/files/small_disk.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

using FileWriterTest = FilesTest;

TEST_F(FileWriterTest, FileAppearsAtCommitAndNotBefore) {
  FileWriter writer(Path("a.txt"));
  writer.Write("one ");
  writer.Write("two");
  EXPECT_FALSE(fs::exists(Path("a.txt")));
  writer.Commit();
  EXPECT_EQ(Bytes(Path("a.txt")), "one two");
  EXPECT_FALSE(fs::exists(Path("a.txt.partial")));
}

TEST_F(FileWriterTest, OverwriteReplacesAndWritingGoesOnAtTheEnd) {
  FileWriter writer(Path("a.txt"));
  writer.Write("count=0000 body");
  writer.Overwrite(6, "1234");
  writer.Write(" end");
  writer.Commit();
  EXPECT_EQ(Bytes(Path("a.txt")), "count=1234 body end");
}

TEST_F(FileWriterTest, WithoutCommitTheOldFileStaysAndNothingElse) {
  Write("a.txt", "old");
  { FileWriter(Path("a.txt")).Write("new"); }
  EXPECT_EQ(Bytes(Path("a.txt")), "old");
  EXPECT_FALSE(fs::exists(Path("a.txt.partial")));
}

TEST_F(FileWriterTest, WriteFailureMidwayLeavesTheOldFileIntact) {
  Write("a.txt", "old");
  const std::string message = MessageOf<OutputError>([&] {
    const FileSizeLimit limit(100000);
    FileWriter writer(Path("a.txt"));
    for (int i = 0; i < 100; ++i) writer.Write(std::string(10000, 'x'));
    writer.Commit();
  });
  EXPECT_THAT(message, AllOf(HasSubstr(Path("a.txt")), HasSubstr("File too large")));
  EXPECT_EQ(Bytes(Path("a.txt")), "old");
  EXPECT_FALSE(fs::exists(Path("a.txt.partial")));
}

TEST_F(FileWriterTest, FailureOfBufferedBytesShowsAtCommit) {
  Write("a.txt", "old");
  const FileSizeLimit limit(10);
  FileWriter writer(Path("a.txt"));
  writer.Write("more than ten bytes");
  EXPECT_THROW(writer.Commit(), OutputError);
  EXPECT_EQ(Bytes(Path("a.txt")), "old");
}

TEST_F(FileWriterTest, AFullDiskIsNamedAndTheOldFileStays) {
  if (!fs::exists("/dev/full")) GTEST_SKIP() << "no /dev/full, the disk that is always full";
  for (const std::size_t bytes : {10U, 1000000U}) {
    Write("a.txt", "old");
    fs::create_symlink("/dev/full", Path("a.txt.partial"));
    const std::string message = MessageOf<OutputError>([&] {
      FileWriter writer(Path("a.txt"));
      writer.Write(std::string(bytes, 'x'));
      writer.Commit();
    });
    EXPECT_THAT(message, AllOf(HasSubstr(Path("a.txt")), HasSubstr("No space left on device")));
    EXPECT_EQ(Bytes(Path("a.txt")), "old");
    EXPECT_FALSE(fs::is_symlink(Path("a.txt.partial")));
  }
}

TEST_F(FileWriterTest, AFullDiskIsAnErrorOfItsOwn) {
  const SmallDisk disk(Path("disk"), 1 << 20);
  if (!disk.mounted()) GTEST_SKIP() << "only root can mount";
  Write("disk/a.txt", "old");
  FileWriter writer(Path("disk/a.txt"));
  EXPECT_THROW(
      {
        writer.Write(std::string(2 << 20, 'x'));
        writer.Commit();
      },
      DiskFullError);
  EXPECT_EQ(Bytes(Path("disk/a.txt")), "old");
}

TEST_F(FileWriterTest, ACopyIsWholeOrNotThere) {
  const std::string bytes = std::string(3000000, 'a') + "end";
  Write("from.bin", bytes);
  CopyFile(Path("from.bin"), Path("to.bin"));
  EXPECT_TRUE(Bytes(Path("to.bin")) == bytes);
  EXPECT_THROW(CopyFile(Path("none.bin"), Path("to.bin")), InputError);
  EXPECT_TRUE(Bytes(Path("to.bin")) == bytes);
  EXPECT_THROW(CopyFile(folder_.string(), Path("to.bin")), InputError);
  EXPECT_TRUE(Bytes(Path("to.bin")) == bytes);
  const SmallDisk disk(Path("disk"), 1 << 20);
  if (!disk.mounted()) GTEST_SKIP() << "only root can mount";
  Write("disk/to.bin", "old");
  EXPECT_THROW(CopyFile(Path("from.bin"), Path("disk/to.bin")), DiskFullError);
  EXPECT_EQ(Bytes(Path("disk/to.bin")), "old");
  EXPECT_FALSE(fs::exists(Path("disk/to.bin.partial")));
}

TEST_F(FileWriterTest, MissingFolderIsNamed) {
  const std::string message =
      MessageOf<OutputError>([&] { FileWriter writer(Path("none/a.txt")); });
  EXPECT_THAT(message, AllOf(HasSubstr("none/a.txt"), HasSubstr("No such file")));
}

TEST_F(FileWriterTest, UnwritableFolderIsNamed) {
  if (geteuid() == 0) GTEST_SKIP() << "root may write anywhere";
  fs::permissions(folder_, fs::perms::owner_read | fs::perms::owner_exec);
  const std::string message = MessageOf<OutputError>([&] { FileWriter writer(Path("a.txt")); });
  fs::permissions(folder_, fs::perms::owner_all);
  EXPECT_THAT(message, AllOf(HasSubstr("a.txt"), HasSubstr("Permission denied")));
}

TEST_F(FileWriterTest, FoldersAndDevicesAreNotReplaced) {
  EXPECT_THROW(FileWriter(folder_.string()), OutputError);
  EXPECT_THROW(FileWriter("/dev/null"), OutputError);
}

TEST_F(FileWriterTest, UseAfterCommitIsAProgrammersError) {
  FileWriter writer(Path("a.txt"));
  writer.Commit();
  EXPECT_THROW(writer.Write("x"), std::logic_error);
  EXPECT_THROW(writer.Overwrite(0, "x"), std::logic_error);
  EXPECT_THROW(writer.Commit(), std::logic_error);
}

}  // namespace
}  // namespace lamina
