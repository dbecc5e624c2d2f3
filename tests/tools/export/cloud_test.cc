#include "tools/export/cloud.h"
#include "io/points/scan_file.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <filesystem>
#include <random>
#include <set>
#include <string>

#include "core/base/error.h"
#include "core/map/voxel_key.h"
#include "tests/support/memory_scans.h"

namespace lamina {
namespace {

// The x y z intensity of a point.
using Row = std::array<float, 4>;

class ExportCloudTest : public testing::Test {
 protected:
  void SetUp() override {
    folder_ = std::filesystem::path(testing::TempDir()) /
              ("export_cloud_" +
               std::string(testing::UnitTest::GetInstance()->current_test_info()->name()));
    std::filesystem::create_directories(folder_);
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  std::vector<Row> Export(const MemoryScans& scans, const std::vector<PosedScan>& posed,
                          const ExportOptions& options, ExportResult* result,
                          const std::string& name = "cloud.ply") {
    const std::string path = (folder_ / name).string();
    CloudWriter writer(path);
    *result = ExportCloud(scans, posed, options, &writer);
    writer.Commit();
    std::vector<Row> rows;
    // Readers refuse a cloud without points.
    if (result->points == 0) return rows;
    for (const ScanPoint& p : ReadScanFile(path, {}).points) {
      rows.push_back({p.x, p.y, p.z, p.intensity});
    }
    EXPECT_EQ(rows.size(), result->points);
    return rows;
  }

  std::filesystem::path folder_;
};

// Scans along a drive, points with their number as intensity.
MemoryScans RandomScans(size_t count, int points) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  std::vector<Scan> scans(count);
  for (size_t i = 0; i < count; ++i) {
    scans[i].stamp_ns = static_cast<StampNs>(i) * 100000000;
    for (int k = 0; k < points; ++k) {
      scans[i].points.push_back(
          ToScanPoint({30.0 * uniform(random), 30.0 * uniform(random), 3.0 * uniform(random)},
                      static_cast<float>(k)));
    }
  }
  return MemoryScans(std::move(scans));
}

std::vector<PosedScan> PosedDrive(size_t count, double step_m) {
  std::vector<PosedScan> posed(count);
  for (size_t i = 0; i < count; ++i) {
    posed[i].scan = i;
    posed[i].T_world_lidar.t.x() = step_m * static_cast<double>(i);
  }
  return posed;
}

TEST_F(ExportCloudTest, KeepsTheFirstPointOfEveryVoxel) {
  const MemoryScans scans = RandomScans(10, 3000);
  const std::vector<PosedScan> posed = PosedDrive(10, 2.0);
  ExportOptions options;
  options.resolution_m = 1.5;
  std::set<VoxelKey> seen;
  std::set<Row> expected;
  for (const PosedScan& pose : posed) {
    for (const ScanPoint& p : scans.Read(pose.scan).points) {
      if (Eigen::Vector3f(p.x, p.y, p.z).norm() < options.preparation.min_range_m) continue;
      const Eigen::Vector3d world = pose.T_world_lidar * Eigen::Vector3d(p.x, p.y, p.z);
      if (!seen.insert(VoxelKeyOf(world, 1.0 / 1.5)).second) continue;
      const Eigen::Vector3f f = world.cast<float>();
      expected.insert({f.x(), f.y(), f.z(), p.intensity});
    }
  }
  for (const char* name : {"cloud.ply", "cloud.pcd"}) {
    ExportResult result;
    const std::vector<Row> rows = Export(scans, posed, options, &result, name);
    EXPECT_EQ(std::set<Row>(rows.begin(), rows.end()), expected);
    EXPECT_EQ(rows.size(), expected.size());
    EXPECT_EQ(result.passes, 1);
  }
}

TEST_F(ExportCloudTest, SmallBudgetGivesTheSamePoints) {
  const MemoryScans scans = RandomScans(40, 5000);
  const std::vector<PosedScan> posed = PosedDrive(40, 5.0);
  ExportOptions options;
  options.resolution_m = 0.3;
  ExportResult one;
  const std::vector<Row> whole = Export(scans, posed, options, &one);
  EXPECT_EQ(one.passes, 1);
  options.budget_mb = 1;
  ExportResult many;
  const std::vector<Row> pieces = Export(scans, posed, options, &many);
  EXPECT_GT(many.passes, 2);
  EXPECT_EQ(pieces.size(), whole.size());
  EXPECT_EQ(std::set<Row>(pieces.begin(), pieces.end()), std::set<Row>(whole.begin(), whole.end()));
}

// One point in space, seen from a turning, moving sensor at ten moments of one sweep.
TEST_F(ExportCloudTest, PointsAreDeskewed) {
  std::vector<PosedScan> posed(1);
  posed[0].sweep.twist << 0.2, 0.1, 1.0, 10.0, 1.0, 0.0;
  posed[0].T_world_lidar = TwistExp(3.0 * posed[0].sweep.twist);
  const Eigen::Vector3d target = posed[0].T_world_lidar * Eigen::Vector3d(10.0, 5.0, 1.0);
  Scan scan;
  for (int i = 0; i < 10; ++i) {
    const float time_s = 0.01F * static_cast<float>(i);
    const SE3 T_world_lidar =
        posed[0].T_world_lidar * TwistExp(static_cast<double>(time_s) * posed[0].sweep.twist);
    scan.points.push_back(ToScanPoint(T_world_lidar.Inverse() * target, 7.0F));
    scan.time_s.push_back(time_s);
  }
  ExportOptions options;
  options.resolution_m = 0.001;
  options.preparation.deskew = ScanPreparationOptions::Deskew::kTime;
  ExportResult result;
  for (const Row& row : Export(MemoryScans({scan}), posed, options, &result)) {
    EXPECT_LT((Eigen::Vector3f(row[0], row[1], row[2]) - target.cast<float>()).norm(), 1e-4F);
    EXPECT_EQ(row[3], 7.0F);
  }
  options.preparation.deskew = ScanPreparationOptions::Deskew::kOff;
  EXPECT_EQ(Export(MemoryScans({scan}), posed, options, &result).size(), 10U);
}

TEST_F(ExportCloudTest, IntensitiesStayWithTheirPoints) {
  Scan scan;
  const float nan = std::nanf("");
  scan.points = {{10, 0, 0, 1}, {0, 0, 0, 2}, {nan, 0, 0, 3}, {20, 0, 0, nan}, {30, 0, 0, 5}};
  ExportResult result;
  const std::vector<Row> rows = Export(MemoryScans({scan}), PosedDrive(1, 0.0), {}, &result);
  EXPECT_EQ(rows, (std::vector<Row>{{10, 0, 0, 1}, {20, 0, 0, 0}, {30, 0, 0, 5}}));
}

TEST_F(ExportCloudTest, CountsWhatLiesBeyondTheGrid) {
  Scan scan;
  scan.points = {{10, 0, 0, 1}};
  std::vector<PosedScan> posed = PosedDrive(1, 0.0);
  posed[0].T_world_lidar.t.y() = 1e6;
  ExportOptions options;
  ExportResult result;
  EXPECT_TRUE(Export(MemoryScans({scan}), posed, options, &result).empty());
  EXPECT_EQ(result.points_beyond_grid, 1U);
  options.resolution_m = 2.0;
  EXPECT_EQ(Export(MemoryScans({scan}), posed, options, &result).size(), 1U);
  EXPECT_EQ(result.points_beyond_grid, 0U);
}

TEST_F(ExportCloudTest, RefusesOptionsOutsideOfTheirRules) {
  ExportResult result;
  ExportOptions options;
  options.resolution_m = -1.0;
  EXPECT_THROW(Export(RandomScans(1, 1), PosedDrive(1, 0.0), options, &result), OptionError);
  options = {};
  options.budget_mb = 0;
  EXPECT_THROW(Export(RandomScans(1, 1), PosedDrive(1, 0.0), options, &result), OptionError);
  EXPECT_TRUE(std::filesystem::is_empty(folder_)) << "a failed export left a file behind";
}

}  // namespace
}  // namespace lamina
