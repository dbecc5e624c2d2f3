#include "tools/refine/journal.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <string>

#include "tests/support/files/io_test_files.h"

namespace lamina {
namespace {

class RefineJournal : public FilesTest {};

TEST_F(RefineJournal, AnInterruptedOneGoesOnWithWhatWasWhole) {
  {
    JournalFile journal(Path("out.progress"), 7);
    journal.Add("first", "1");
    journal.Add("second", "22");
    journal.Sync();
    EXPECT_EQ(journal.found(), 0U);
  }
  // The last record was under way.
  std::filesystem::resize_file(Path("out.progress"),
                               std::filesystem::file_size(Path("out.progress")) - 1);
  {
    JournalFile journal(Path("out.progress"), 7);
    EXPECT_EQ(journal.found(), 1U);
    EXPECT_EQ(journal.Find("first"), "1");
    EXPECT_FALSE(journal.Find("second"));
    journal.Add("third", "333");
  }
  {
    JournalFile journal(Path("out.progress"), 7);
    EXPECT_EQ(journal.found(), 2U);
    EXPECT_EQ(journal.Find("third"), "333");
  }
  // Of something else it is of no use.
  JournalFile journal(Path("out.progress"), 8);
  EXPECT_EQ(journal.found(), 0U);
  EXPECT_FALSE(journal.Find("first"));
  journal.Remove();
  EXPECT_FALSE(std::filesystem::exists(Path("out.progress")));
}

}  // namespace
}  // namespace lamina
