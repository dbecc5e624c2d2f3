#include "tools/metrics/map_quality.h"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>
#include <cstdlib>
#include <random>
#include <string>

#include "core/base/error.h"
#include "io/map/trajectory_io.h"
#include "tests/support/memory_scans.h"
#include "tools/results/posed_scans.h"

namespace lamina {
namespace {

constexpr StampNs kFrameNs = 100000000;

// The eight corners of a box: covariance diag(half_sizes^2), exactly.
void AddBox(const Eigen::Vector3d& centre, const Eigen::Vector3d& half_sizes, Scan* scan) {
  for (int corner = 0; corner < 8; ++corner) {
    const Eigen::Vector3d sign(corner & 1 ? 1 : -1, corner & 2 ? 1 : -1, corner & 4 ? 1 : -1);
    scan->points.push_back(ToScanPoint(centre + sign.cwiseProduct(half_sizes)));
  }
}

// `count` scans, each with one box.
std::vector<Scan> BoxScans(int count, const Eigen::Vector3d& centre,
                           const Eigen::Vector3d& half_sizes) {
  std::vector<Scan> scans(static_cast<size_t>(count));
  for (size_t i = 0; i < scans.size(); ++i) {
    scans[i].stamp_ns = static_cast<StampNs>(i) * kFrameNs;
    AddBox(centre, half_sizes, &scans[i]);
  }
  return scans;
}

Trajectory Standing(size_t count) {
  Trajectory trajectory(count);
  for (size_t i = 0; i < count; ++i) trajectory[i].stamp_ns = static_cast<StampNs>(i) * kFrameNs;
  return trajectory;
}

double BoxEntropy(const Eigen::Vector3d& half_sizes) {
  return 0.5 * std::log(std::pow(2.0 * M_PI * M_E, 3)) + std::log(half_sizes.prod());
}

const Eigen::Vector3d kCentre(10.5, 0.5, 0.5);
const Eigen::Vector3d kPlate(0.3, 0.25, 0.01);

MapQualityReport Measure(const std::vector<Scan>& scans,
                         const std::vector<NamedTrajectory>& trajectories,
                         const MapQualityOptions& options = {}) {
  return MeasureMapQuality(MemoryScans(scans), trajectories, options);
}

TEST(MapQuality, IsExactForBoxes) {
  const MapQualityReport report = Measure(BoxScans(3, kCentre, kPlate), {{"a", Standing(3)}});
  ASSERT_EQ(report.trajectories.size(), 1U);
  const MapQuality& q = report.trajectories[0];
  EXPECT_EQ(report.scans, 3U);
  EXPECT_EQ(q.voxels, 1U);
  EXPECT_EQ(q.planar_voxels, 1U);
  EXPECT_NEAR(q.mme, BoxEntropy(kPlate), 1e-5);
  EXPECT_NEAR(q.thickness_mean_mm, 10.0, 1e-3);
  EXPECT_NEAR(q.thickness_median_mm, 10.0, 1e-3);
  EXPECT_DOUBLE_EQ(q.common_mme, q.mme);
  EXPECT_DOUBLE_EQ(q.common_thickness_mm, q.thickness_mean_mm);
}

TEST(MapQuality, AThickBoxIsNotPlanar) {
  // 0.0625 against 0.25: an eigenvalue ratio of just 1/16, and a little less.
  const Eigen::Vector3d thick(0.3, 0.25, 0.0626);
  const Eigen::Vector3d thin(0.3, 0.25, 0.0624);
  EXPECT_EQ(
      Measure(BoxScans(3, kCentre, thick), {{"a", Standing(3)}}).trajectories[0].planar_voxels, 0U);
  EXPECT_EQ(Measure(BoxScans(3, kCentre, thin), {{"a", Standing(3)}}).trajectories[0].planar_voxels,
            1U);
}

TEST(MapQuality, CountsVoxelsOfEnoughPointsAndFramesInRange) {
  // 16 points of 2 frames; then 3 frames, but too near; then fine.
  EXPECT_THROW(Measure(BoxScans(2, kCentre, kPlate), {{"a", Standing(2)}}), InputError);
  std::vector<Scan> scans = BoxScans(4, kCentre, kPlate);
  scans[3].points.clear();
  AddBox({4.5, 0.5, 0.5}, kPlate, &scans[0]);
  AddBox({4.5, 0.5, 0.5}, kPlate, &scans[1]);
  AddBox({4.5, 0.5, 0.5}, kPlate, &scans[2]);
  EXPECT_EQ(Measure(scans, {{"a", Standing(4)}}).trajectories[0].voxels, 1U);
  MapQualityOptions options;
  options.min_range_m = 2.0;
  EXPECT_EQ(Measure(scans, {{"a", Standing(4)}}, options).trajectories[0].voxels, 2U);
  options.min_points = 25;
  EXPECT_EQ(Measure(scans, {{"a", Standing(4)}}, options).trajectories[0].voxels, 0U);
  options.min_points = 20;
  options.min_frames = 4;
  const MapQuality none = Measure(scans, {{"a", Standing(4)}}, options).trajectories[0];
  EXPECT_EQ(none.voxels, 0U);
  EXPECT_TRUE(std::isnan(none.mme));
  EXPECT_TRUE(std::isnan(none.thickness_median_mm));
}

// Walls with Gaussian noise all around a sensor that drives through: the noise is the thickness.
TEST(MapQuality, RecoversTheNoiseOfPlanes) {
  const double sigma_m = 0.02;
  std::mt19937 random(1);
  std::normal_distribution<double> noise(0.0, sigma_m);
  std::uniform_real_distribution<double> along(-20.0, 20.0);
  std::vector<Scan> scans(20);
  Trajectory truth(20);
  for (size_t i = 0; i < scans.size(); ++i) {
    truth[i].stamp_ns = scans[i].stamp_ns = static_cast<StampNs>(i) * kFrameNs;
    truth[i].T_world_lidar = SE3(ExpSO3({0.0, 0.0, 0.05 * static_cast<double>(i)}),
                                 {0.2 * static_cast<double>(i), 0, 0});
    const SE3 T_lidar_world = truth[i].T_world_lidar.Inverse();
    for (int k = 0; k < 20000; ++k) {
      const Eigen::Vector3d wall(along(random), (k % 2 == 0 ? 10.5 : -10.5) + noise(random),
                                 0.1 * along(random));
      scans[i].points.push_back(ToScanPoint(T_lidar_world * wall));
    }
  }
  const MapQuality q = Measure(scans, {{"truth", truth}}).trajectories[0];
  EXPECT_GT(q.planar_voxels, 250U);
  EXPECT_NEAR(q.thickness_mean_mm, 1e3 * sigma_m, 0.02 * 1e3 * sigma_m);
  EXPECT_NEAR(q.thickness_median_mm, 1e3 * sigma_m, 0.02 * 1e3 * sigma_m);
}

TEST(MapQuality, ComparesOnTheVoxelsThatAllShare) {
  // Two places, each seen by five scans. "torn" tears the second place apart.
  const Eigen::Vector3d second(20.5, 0.5, 0.5);
  std::vector<Scan> scans = BoxScans(10, kCentre, kPlate);
  for (size_t i = 5; i < 10; ++i) {
    scans[i].points.clear();
    AddBox(second, {0.3, 0.3, 0.3}, &scans[i]);
  }
  Trajectory torn = Standing(10);
  for (size_t i = 5; i < 10; ++i) torn[i].T_world_lidar.t.y() = 3.0 * static_cast<double>(i);
  const MapQualityReport report = Measure(scans, {{"whole", Standing(10)}, {"torn", torn}});
  EXPECT_EQ(report.common_voxels, 1U);
  EXPECT_EQ(report.common_planar_voxels, 1U);
  const MapQuality& a = report.trajectories[0];
  const MapQuality& b = report.trajectories[1];
  EXPECT_EQ(a.voxels, 2U);
  EXPECT_EQ(b.voxels, 1U);
  EXPECT_NEAR(a.mme, 0.5 * (BoxEntropy(kPlate) + BoxEntropy({0.3, 0.3, 0.3})), 1e-5);
  // By its own voxels the torn map looks the crisper one.
  EXPECT_LT(b.mme, a.mme);
  EXPECT_NEAR(a.common_mme, BoxEntropy(kPlate), 1e-5);
  EXPECT_DOUBLE_EQ(a.common_mme, b.common_mme);
}

TEST(MapQuality, AVoxelPlanarInOneMapCountsInAll) {
  Trajectory blurred = Standing(3);
  blurred[1].T_world_lidar.t.z() = 0.1;
  blurred[2].T_world_lidar.t.z() = -0.1;
  const MapQualityReport report =
      Measure(BoxScans(3, kCentre, kPlate), {{"sharp", Standing(3)}, {"blurred", blurred}});
  const MapQuality& b = report.trajectories[1];
  EXPECT_EQ(report.common_planar_voxels, 1U);
  EXPECT_EQ(b.planar_voxels, 0U);
  EXPECT_TRUE(std::isnan(b.thickness_mean_mm));
  const double thickness_m = std::sqrt(0.01 * 0.01 + 2.0 / 3.0 * 0.1 * 0.1);
  EXPECT_NEAR(b.common_thickness_mm, 1e3 * thickness_m, 1e-2);
  EXPECT_NEAR(report.trajectories[0].common_thickness_mm, 10.0, 1e-3);
}

TEST(MapQuality, UsesTheScansThatEveryTrajectoryHas) {
  const std::vector<Scan> scans = BoxScans(8, kCentre, kPlate);
  Trajectory some = Standing(8);
  some.erase(some.begin() + 5);
  some.erase(some.begin());
  const MapQualityReport report = Measure(scans, {{"all", Standing(8)}, {"some", some}});
  EXPECT_EQ(report.scans, 6U);
  EXPECT_EQ(report.trajectories[0].name, "all");
  EXPECT_EQ(report.trajectories[1].name, "some");
  EXPECT_DOUBLE_EQ(report.trajectories[0].mme, report.trajectories[1].mme);
}

TEST(MapQuality, DoesNotDependOnTheWorldFrame) {
  const std::vector<Scan> scans = BoxScans(5, kCentre, kPlate);
  Trajectory elsewhere = Standing(5);
  Vector6d twist;
  twist << 0.4, -0.3, 2.0, 4e5, 5e6, 100.0;
  for (StampedPose& pose : elsewhere) pose.T_world_lidar = TwistExp(twist) * pose.T_world_lidar;
  const MapQualityReport report = Measure(scans, {{"here", Standing(5)}, {"there", elsewhere}});
  EXPECT_EQ(report.common_voxels, 1U);
  EXPECT_NEAR(report.trajectories[0].mme, report.trajectories[1].mme, 1e-6);
}

// A sensor on a curve sees a wall point by point, each from where it is at that moment.
TEST(MapQuality, DeskewsByTheTrajectorysOwnMotion) {
  Vector6d twist;
  twist << 0.1, -0.05, 0.6, 8.0, 0.5, -0.3;
  std::mt19937 random(2);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  std::vector<Scan> scans(6);
  Trajectory truth(6);
  for (size_t i = 0; i < scans.size(); ++i) {
    truth[i].stamp_ns = scans[i].stamp_ns = static_cast<StampNs>(i) * kFrameNs;
    truth[i].T_world_lidar = TwistExp(0.1 * static_cast<double>(i) * twist);
    for (int k = 0; k < 4000; ++k) {
      const double time_s = 0.05 * uniform(random);
      const Eigen::Vector3d wall(15.5, 5.0 * uniform(random), 3.0 * uniform(random));
      const SE3 T_world_lidar = truth[i].T_world_lidar * TwistExp(time_s * twist);
      scans[i].points.push_back(ToScanPoint(T_world_lidar.Inverse() * wall));
      scans[i].time_s.push_back(static_cast<float>(time_s));
    }
  }
  MapQualityOptions options;
  const MapQuality deskewed = Measure(scans, {{"truth", truth}}, options).trajectories[0];
  EXPECT_GT(deskewed.planar_voxels, 30U);
  // What remains is the floor of the eigenvalues.
  EXPECT_NEAR(deskewed.thickness_mean_mm, 0.1, 1e-6);
  options.preparation.deskew = ScanPreparationOptions::Deskew::kOff;
  const MapQuality smeared = Measure(scans, {{"truth", truth}}, options).trajectories[0];
  EXPECT_GT(smeared.mme, deskewed.mme + 2.0);
  EXPECT_LT(smeared.planar_voxels, deskewed.planar_voxels / 2);
}

// 10.5 m ahead, a turn by half a degree lifts a box by 9 cm: here half of it into the voxel above.
TEST(MapQuality, AppliesTheVerticalCorrection) {
  const std::vector<Scan> scans = BoxScans(5, {10.5, 0.5, 0.92}, {0.05, 0.05, 0.05});
  MapQualityOptions options;
  EXPECT_EQ(Measure(scans, {{"a", Standing(5)}}, options).trajectories[0].voxels, 1U);
  options.preparation.vertical_correction_deg = 0.5;
  EXPECT_EQ(Measure(scans, {{"a", Standing(5)}}, options).trajectories[0].voxels, 2U);
}

TEST(MapQuality, CountsWhatFliesOutOfTheGrid) {
  Trajectory lost = Standing(4);
  lost[3].T_world_lidar.t.x() = 1e9;
  const MapQuality q = Measure(BoxScans(4, kCentre, kPlate), {{"lost", lost}}).trajectories[0];
  EXPECT_EQ(q.points_beyond_grid, 8U);
  EXPECT_EQ(q.voxels, 1U);
}

TEST(MapQuality, IsTheSameAtAnyNumberOfThreads) {
  std::mt19937 random(3);
  std::normal_distribution<double> normal;
  std::vector<Scan> scans = BoxScans(40, kCentre, kPlate);
  Trajectory trajectory = Standing(40);
  for (size_t i = 0; i < scans.size(); ++i) {
    trajectory[i].T_world_lidar.t.x() = 0.1 * normal(random);
    for (int k = 0; k < 2000; ++k) {
      scans[i].points.push_back(
          ToScanPoint({20.0 * normal(random), 20.0 * normal(random), normal(random)}));
    }
  }
  std::vector<double> entropies;
  for (const size_t threads : {1U, 2U, 8U}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    entropies.push_back(Measure(scans, {{"a", trajectory}}).trajectories[0].mme);
  }
  EXPECT_EQ(entropies[0], entropies[1]);
  EXPECT_EQ(entropies[0], entropies[2]);
}

TEST(MapQuality, RefusesBadInput) {
  const std::vector<Scan> scans = BoxScans(5, kCentre, kPlate);
  Trajectory other_day = Standing(5);
  for (StampedPose& pose : other_day) pose.stamp_ns += 86400000000000;
  try {
    Measure(scans, {{"a", Standing(5)}, {"b", other_day}});
    FAIL() << "a trajectory of another day was accepted";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("only 0 of 5 scans"), std::string::npos);
  }
  MapQualityOptions options;
  options.voxel_size_m = 0.0;
  EXPECT_THROW(Measure(scans, {{"a", Standing(5)}}, options), OptionError);
}

// Figures of an independent implementation in numpy, points deskewed to the middle of the sweep.
TEST(MapQuality, AgreesWithAnIndependentJudgeOnARealDrive) {
  const char* recordings = std::getenv("LAMINA_RECORDINGS");
  if (recordings == nullptr) GTEST_SKIP() << "LAMINA_RECORDINGS names no folder of recordings";
  const std::string drive = std::string(recordings) + "/kitti_raw_0005_first70";
  const std::unique_ptr<ScanSource> scans = OpenScans(drive, {});
  const std::vector<StampNs> stamps = ScanStamps(*scans);
  const auto read = [&](const std::string& name) {
    return NamedTrajectory{name, ReadTrajectory(drive + "/" + name, stamps)};
  };
  MapQualityOptions options;
  options.preparation.deskew = ScanPreparationOptions::Deskew::kAzimuth;
  const MapQualityReport report =
      MeasureMapQuality(*scans,
                        {read("peers/kiss_raw.txt"), read("peers/mad_raw.txt"),
                         read("poses_reference.txt"), read("peers/small_gicp_model_raw.txt")},
                        options);
  EXPECT_EQ(report.common_voxels, 7679U);
  EXPECT_EQ(report.common_planar_voxels, 3577U);
  struct Expected {
    size_t voxels, planar;
    double mme, mean_mm, median_mm, common_mm, common_mme;
  };
  const std::vector<Expected> judged{{8331, 3393, -1.7549, 25.361, 21.472, 32.219, -1.6572},
                                     {8368, 3494, -1.8113, 23.674, 19.484, 30.506, -1.7044},
                                     {8263, 3730, -2.0537, 19.602, 12.714, 21.931, -1.9638},
                                     {8333, 3435, -1.8791, 20.736, 14.517, 28.640, -1.7797}};
  for (size_t k = 0; k < judged.size(); ++k) {
    const MapQuality& q = report.trajectories[k];
    SCOPED_TRACE(q.name);
    EXPECT_EQ(q.voxels, judged[k].voxels);
    EXPECT_EQ(q.planar_voxels, judged[k].planar);
    EXPECT_NEAR(q.mme, judged[k].mme, 1.5e-4);
    EXPECT_NEAR(q.thickness_mean_mm, judged[k].mean_mm, 2e-3);
    EXPECT_NEAR(q.thickness_median_mm, judged[k].median_mm, 2e-3);
    EXPECT_NEAR(q.common_thickness_mm, judged[k].common_mm, 2e-3);
    EXPECT_NEAR(q.common_mme, judged[k].common_mme, 1.5e-4);
  }
}

}  // namespace
}  // namespace lamina
