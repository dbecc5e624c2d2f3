#include "config/recording_list.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "tests/support/files/io_test_files.h"

namespace lamina {
namespace {

using testing::HasSubstr;

class RecordingListTest : public FilesTest {
 protected:
  // What is said of a list that is wrong.
  std::string Refused(const std::string& text) const {
    const std::string list = Write("list.yaml", text);
    return MessageOf<OptionError>([&] { ReadRecordingList(list); });
  }
};

TEST_F(RecordingListTest, PathsPatternsAndRecordingsWithMore) {
  Write("bags/b.bag", "");
  Write("bags/a.bag", "");
  const std::string list = Write("list.yaml",
                                 "recordings:\n"
                                 "  - drives/first/\n"
                                 "  - bags/*.bag\n"
                                 "  - scans: /elsewhere/first\n"
                                 "    name: night\n"
                                 "    frames: 10:20\n"
                                 "    topic: /os_cloud\n");
  const std::vector<ListedRecording> found = ReadRecordingList(list);
  ASSERT_EQ(found.size(), 4U);
  const std::filesystem::path folder = std::filesystem::absolute(list).parent_path();
  EXPECT_EQ(found[0].name, "first");
  EXPECT_EQ(found[0].scans, (folder / "drives/first/").string());
  EXPECT_EQ(found[1].name, "a.bag");
  EXPECT_EQ(found[2].scans, (folder / "bags/b.bag").string());
  EXPECT_EQ(found[3].name, "night");
  EXPECT_EQ(found[3].scans, "/elsewhere/first");
  EXPECT_EQ(found[3].frames, "10:20");
  EXPECT_EQ(found[3].topic, "/os_cloud");
}

TEST_F(RecordingListTest, WhatIsWrongIsNamedWithItsLine) {
  const std::vector<std::pair<std::string, std::string>> cases = {
      {"recordings:\n  - a\n  - scans: b\n    frame: 3\n", "list.yaml:4: unknown key `frame`"},
      {"recordings:\n  - a\n  - other/a\n", "list.yaml:3: name `a`: is that of line 2, too"},
      {"recordings:\n  - none/*.bag\n", "list.yaml:2: nothing matches"},
      {"recordings:\n  - name: a\n", "list.yaml:2: scans is missing"},
      {"recordings:\n  - scans: a\n    name: b/c\n", "must be the name of a folder"},
      {"recordings: []\n", "lists no recordings"},
      {"recordings: a\n", "list.yaml:1: recordings must be a list"},
      {"scans:\n  - a\n", "list.yaml:1: unknown key `scans`"},
      {"- a\n", "must have `recordings:`"},
      {"recordings:\n  - [a\n", "list.yaml:3: not valid YAML"},
      {"? [recordings]\n: - a\n", "list.yaml:1: not valid YAML"},
  };
  for (const auto& [text, message] : cases) EXPECT_THAT(Refused(text), HasSubstr(message)) << text;
  EXPECT_THROW(ReadRecordingList(Path("none.yaml")), InputError);
  EXPECT_THAT(MessageOf<InputError>([&] { ReadRecordingList(Path("")); }),
              HasSubstr("cannot be read: Is a directory"));
}

}  // namespace
}  // namespace lamina
