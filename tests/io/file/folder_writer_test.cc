#include "io/file/folder_writer.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <string>

#include "core/base/error.h"
#include "tests/support/files/io_test_files.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

class FolderWriterTest : public FilesTest {};

TEST_F(FolderWriterTest, AFolderIsWholeOrNotThere) {
  Write("out.part/left_behind", "by a process that was killed");
  {
    const FolderWriter folder(Path("out"), Path("out.part"));
    EXPECT_FALSE(fs::exists(Path("out.part/left_behind")));
    Write("out.part/result", "half");
  }
  EXPECT_FALSE(fs::exists(Path("out.part")));
  EXPECT_FALSE(fs::exists(Path("out")));
  FolderWriter folder(Path("out"), Path("out.part"));
  Write("out.part/result", "whole");
  folder.Commit();
  EXPECT_FALSE(fs::exists(Path("out.part")));
  EXPECT_TRUE(HoldsText(Path("out/result"), "whole"));
}

TEST_F(FolderWriterTest, WhatIsThereIsReplacedOnlyWhenAskedTo) {
  Write("out/before", "1");
  FolderWriter folder(Path("out"), Path("out.part"));
  Write("out.part/now", "2");
  EXPECT_THROW(folder.Commit(), OutputError);
  EXPECT_TRUE(HoldsText(Path("out/before"), "1"));
  folder.Replace();
  EXPECT_FALSE(fs::exists(Path("out/before")));
  EXPECT_TRUE(HoldsText(Path("out/now"), "2"));
}

TEST_F(FolderWriterTest, AMarkHoldsItsTextOrDoesNot) {
  Write("mark", "of this");
  EXPECT_TRUE(HoldsText(Path("mark"), "of this"));
  EXPECT_FALSE(HoldsText(Path("mark"), "of that"));
  EXPECT_FALSE(HoldsText(Path("none"), ""));
}

}  // namespace
}  // namespace lamina
