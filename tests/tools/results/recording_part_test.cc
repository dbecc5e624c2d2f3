#include "tools/results/recording_part.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "io/map/trajectory_io.h"
#include "tests/support/program/run_helpers.h"

namespace lamina {
namespace {

using testing::ElementsAre;

class RecordingPartTest : public RunTest {
 protected:
  // Scan files of these numbers, which are not read.
  RecordingPart PartOfFiles(const std::vector<std::size_t>& numbers, FrameRange range) const {
    for (const std::size_t number : numbers) Write("scans/velodyne/" + ScanName(number), "");
    return PartOf(*OpenScans(Path("scans"), {}), range);
  }
  // One pose a line, its number of metres ahead.
  std::string WriteLines(int count) const {
    Trajectory lines;
    for (int i = 0; i < count; ++i)
      lines.push_back({i, SE3(Eigen::Quaterniond::Identity(), {1.0 * i, 0.0, 0.0})});
    WriteKittiTrajectory(Path("lines.txt"), lines);
    return Path("lines.txt");
  }
};

// As in raw drives, whose poses have a line for those as well.
TEST_F(RecordingPartTest, LinesOfScansThatAreMissingAreLeftOut) {
  const RecordingPart part = PartOfFiles({2, 3, 5, 6, 9}, {1, 5});
  EXPECT_EQ(part.first_number, 2U);
  EXPECT_THAT(part.missing_numbers, ElementsAre(4U, 7U, 8U));
  EXPECT_EQ(part.NumberOf(0), 2U);
  EXPECT_EQ(part.NumberOf(4), 9U);
  Write("summary.json", nlohmann::json({{"recording", ToJson(part)}}).dump());
  const auto read = ReadRecordingPart(Path("."));
  ASSERT_TRUE(read);
  EXPECT_EQ(read->missing_numbers, part.missing_numbers);
  std::vector<double> ahead_m;
  for (const StampedPose& pose : ReadPosesOfPart(WriteLines(12), *read, {}))
    ahead_m.push_back(pose.T_world_lidar.t.x());
  EXPECT_THAT(ahead_m, ElementsAre(3.0, 5.0, 6.0, 9.0));
  EXPECT_THROW(ReadPosesOfPart(WriteLines(9), *read, {}), InputError) << "none for scan 9";
}

TEST_F(RecordingPartTest, StampsAsNamesAreNoNumbers) {
  const RecordingPart part = PartOfFiles({100000, 250000, 400000}, {0, 3});
  EXPECT_FALSE(part.first_number);
  EXPECT_THAT(part.missing_numbers, testing::IsEmpty());
}

}  // namespace
}  // namespace lamina
