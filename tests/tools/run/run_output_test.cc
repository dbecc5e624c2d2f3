#include "tools/run/run_output.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "tests/support/good_scan.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

// What the verdict is on scans at 10 m/s whose poses, as known when they came and at last, may
// start as they should or half a metre too far for each of the first ten.
RunVerdict VerdictOn(bool comes_wrong, bool ends_wrong) {
  const fs::path folder = fs::path(testing::TempDir()) / "lamina_run_output_test";
  fs::create_directories(folder);
  RunOutput output(folder.string(), 20);
  for (int i = 0; i < 100; ++i) {
    const auto off_m = [&](bool wrong) { return wrong && i < 10 && i % 2 == 1 ? 0.5 : 0.0; };
    ScanRecord scan = GoodScan(i);
    FinalPose pose;
    pose.scan = static_cast<std::size_t>(i);
    pose.pose = {scan.stamp_ns, scan.T_world_lidar};
    pose.pose.T_world_lidar.t.x() += off_m(ends_wrong);
    scan.T_world_lidar.t.x() += off_m(comes_wrong);
    output.Add(scan);
    output.Add(pose);
  }
  return output.Judge();
}

TEST(RunOutputTest, TheVerdictIsOnThePosesThatAreWritten) {
  EXPECT_EQ(VerdictOn(false, false).grade, RunVerdict::Grade::kGood);
  EXPECT_EQ(VerdictOn(false, true).grade, RunVerdict::Grade::kWrong);
  // A start that was overruled.
  EXPECT_EQ(VerdictOn(true, false).grade, RunVerdict::Grade::kGood);
}

}  // namespace
}  // namespace lamina
