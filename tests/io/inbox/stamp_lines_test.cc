// Stamp files that grow or are replaced while they are read.
#include "io/inbox/stamp_lines.h"

#include "tests/support/files/io_test_files.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;
using testing::ElementsAre;
using testing::HasSubstr;

class StampLinesTest : public FilesTest {
 protected:
  std::vector<double> Seconds() const {
    std::vector<double> seconds;
    StampNs stamp_ns = 0;
    for (std::size_t i = 0; lines_.At(i, &stamp_ns) == StampLines::Line::kThere; ++i) {
      seconds.push_back(static_cast<double>(stamp_ns) * 1e-9);
    }
    return seconds;
  }
  void Append(const std::string& text) const {
    std::ofstream(Path("times.txt"), std::ios::app) << text;
  }

  StampLines lines_{Path("times.txt")};
};

TEST_F(StampLinesTest, GrowsLineByLineAndHalfLinesDoNotCount) {
  EXPECT_FALSE(lines_.Refresh(false));
  EXPECT_FALSE(lines_.exists());
  Append("# seconds\n\n1.5\n2.");
  EXPECT_TRUE(lines_.Refresh(false));
  EXPECT_THAT(Seconds(), ElementsAre(1.5));
  EXPECT_TRUE(lines_.has_unfinished_line());
  EXPECT_FALSE(lines_.Refresh(false));
  EXPECT_TRUE(lines_.Refresh(true));
  EXPECT_THAT(Seconds(), ElementsAre(1.5, 2.0));
  EXPECT_FALSE(lines_.Refresh(true));
  // The half line was not its end after all.
  Append("25\r\n3\n");
  EXPECT_TRUE(lines_.Refresh(false));
  EXPECT_THAT(Seconds(), ElementsAre(1.5, 2.25, 3.0));
  EXPECT_FALSE(lines_.has_unfinished_line());
}

TEST_F(StampLinesTest, AReplacedOrShortenedFileIsReadAgain) {
  Append("1\n2\n3\n");
  lines_.Refresh(false);
  Write("new", "4\n5\n6\n7\n");
  fs::rename(Path("new"), Path("times.txt"));
  EXPECT_TRUE(lines_.Refresh(false));
  EXPECT_THAT(Seconds(), ElementsAre(4.0, 5.0, 6.0, 7.0));
  Write("times.txt", "8\n");
  EXPECT_TRUE(lines_.Refresh(false));
  EXPECT_THAT(Seconds(), ElementsAre(8.0));
  // Gone: what was read stays.
  fs::remove(Path("times.txt"));
  EXPECT_TRUE(lines_.Refresh(false));
  EXPECT_FALSE(lines_.exists());
  EXPECT_THAT(Seconds(), ElementsAre(8.0));
}

TEST_F(StampLinesTest, LinesThatAreNoStampsAreNamed) {
  Append("1\nx\n3\n");
  lines_.Refresh(false);
  StampNs stamp_ns = 0;
  EXPECT_EQ(lines_.At(1, &stamp_ns), StampLines::Line::kBad);
  EXPECT_THAT(lines_.Missing(1), HasSubstr("times.txt: stamp 2 must be seconds"));
  EXPECT_EQ(lines_.At(2, &stamp_ns), StampLines::Line::kThere);
  EXPECT_EQ(lines_.At(3, &stamp_ns), StampLines::Line::kMissing);
  EXPECT_THAT(lines_.Missing(3), HasSubstr("ends after 3 stamps, stamp 4 is wanted"));
}

}  // namespace
}  // namespace lamina
