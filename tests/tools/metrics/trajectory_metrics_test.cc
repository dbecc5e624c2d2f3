#include "tools/metrics/trajectory_metrics.h"
#include "core/base/angle.h"

#include <gtest/gtest.h>

#include <array>
#include <cstdlib>
#include <fstream>
#include <random>
#include <string>

#include "core/base/error.h"

namespace lamina {
namespace {

constexpr StampNs kPeriodNs = 100000000;

SE3 Position(double x, double y, double z) {
  return SE3(Eigen::Quaterniond::Identity(), Eigen::Vector3d(x, y, z));
}

// `count` poses, `step_m` apart on the x axis.
Trajectory Straight(int count, double step_m) {
  Trajectory trajectory;
  for (int i = 0; i < count; ++i) trajectory.push_back({i * kPeriodNs, Position(i * step_m, 0, 0)});
  return trajectory;
}

Vector6d RandomTwist(std::mt19937* random, double rotation, double translation) {
  std::normal_distribution<double> normal;
  Vector6d twist;
  for (int k = 0; k < 6; ++k) twist(k) = (k < 3 ? rotation : translation) * normal(*random);
  return twist;
}

// A wandering path in space, and the same with noise on every pose.
Trajectory Wandering(std::mt19937* random, int count) {
  Trajectory trajectory{{0, TwistExp(RandomTwist(random, 1.0, 100.0))}};
  for (int i = 1; i < count; ++i) {
    Vector6d twist = RandomTwist(random, 0.05, 0.1);
    twist(3) += 1.0;
    trajectory.push_back({i * kPeriodNs, trajectory.back().T_world_lidar * TwistExp(twist)});
  }
  return trajectory;
}

Trajectory Noisy(const Trajectory& trajectory, std::mt19937* random) {
  Trajectory noisy = trajectory;
  for (StampedPose& pose : noisy) {
    pose.T_world_lidar = Retract(pose.T_world_lidar, RandomTwist(random, 0.01, 0.05));
  }
  return noisy;
}

Trajectory Moved(const SE3& T, Trajectory trajectory) {
  for (StampedPose& pose : trajectory) pose.T_world_lidar = T * pose.T_world_lidar;
  return trajectory;
}

TEST(TrajectoryMetrics, EqualTrajectoriesHaveNoError) {
  std::mt19937 random(1);
  const Trajectory truth = Wandering(&random, 300);
  const TrajectoryErrors e = CompareTrajectories(truth, truth, Alignment::kSe3);
  EXPECT_EQ(e.poses, 300);
  EXPECT_LT(e.ape_max_m, 1e-9);
  EXPECT_LT(e.rpe_rmse_m, 1e-9);
  EXPECT_LT(e.rpe_rmse_deg, 1e-9);
  EXPECT_LT(e.kitti_trel_percent, 1e-9);
}

TEST(TrajectoryMetrics, ScaledPathErrsByItsScaleInPercent) {
  const Trajectory truth = Straight(1001, 1.0);
  const TrajectoryErrors e = CompareTrajectories(Straight(1001, 1.01), truth, Alignment::kFirst);
  EXPECT_DOUBLE_EQ(e.length_m, 1000.0);
  EXPECT_NEAR(e.kitti_trel_percent, 1.0, 1e-9);
  EXPECT_NEAR(e.kitti_rrel_deg_per_m, 0.0, 1e-9);
  EXPECT_NEAR(e.rpe_rmse_m, 0.01, 1e-12);
  EXPECT_NEAR(e.ape_max_m, 10.0, 1e-9);
  EXPECT_NEAR(e.ape_mean_m, 5.0, 1e-9);
  // Root mean square of 0.01 i, i = 0..1000.
  EXPECT_NEAR(e.ape_rmse_m, 0.01 * std::sqrt(1000.0 * 2001.0 / 6.0), 1e-9);
  EXPECT_NEAR(e.first_to_last_m, 1010.0, 1e-9);
}

TEST(TrajectoryMetrics, CountsSegmentsOfEveryLength) {
  const Trajectory truth = Straight(451, 1.0);
  const TrajectoryErrors e = CompareTrajectories(truth, truth, Alignment::kFirst);
  ASSERT_EQ(e.short_segments.size(), 4U);
  const std::array<double, 4> lengths{5.0, 10.0, 20.0, 50.0};
  for (size_t k = 0; k < lengths.size(); ++k) {
    EXPECT_DOUBLE_EQ(e.short_segments[k].length_m, lengths[k]);
    // Starts 0 .. 450 - L.
    EXPECT_EQ(e.short_segments[k].segments, 451 - static_cast<int>(lengths[k]));
  }
  ASSERT_EQ(e.kitti_segments.size(), 8U);
  for (size_t k = 0; k < 8; ++k) {
    const int hundreds = static_cast<int>(k) + 1;
    EXPECT_DOUBLE_EQ(e.kitti_segments[k].length_m, 100.0 * hundreds);
    const int starts = hundreds <= 4 ? (450 - 100 * hundreds) / 10 + 1 : 0;
    EXPECT_EQ(e.kitti_segments[k].segments, starts);
    EXPECT_EQ(std::isnan(e.kitti_segments[k].translation_percent), starts == 0);
    EXPECT_EQ(std::isnan(e.kitti_segments[k].rotation_deg_per_m), starts == 0);
  }
}

// The mean over segments weighs a length by its number of segments: here the second half of the
// path alone is wrong, which the lengths see to a different degree.
TEST(TrajectoryMetrics, KittiMeanIsOverSegmentsNotOverLengths) {
  const Trajectory truth = Straight(401, 1.0);
  Trajectory estimate = truth;
  for (int i = 201; i <= 400; ++i) {
    estimate[static_cast<size_t>(i)].T_world_lidar = Position(200.0 + 1.02 * (i - 200), 0, 0);
  }
  const TrajectoryErrors e = CompareTrajectories(estimate, truth, Alignment::kFirst);
  double sum = 0.0;
  int count = 0;
  for (int length = 100; length <= 400; length += 100) {
    for (int i = 0; i + length <= 400; i += 10) {
      const double wrong = 0.02 * (std::max(i + length - 200, 0) - std::max(i - 200, 0));
      sum += 100.0 * wrong / length;
      ++count;
    }
  }
  EXPECT_NEAR(e.kitti_trel_percent, sum / count, 1e-9);
}

TEST(TrajectoryMetrics, RotationDriftIsItsRate) {
  const double degrees_per_m = 0.02;
  const Trajectory truth = Straight(501, 1.0);
  Trajectory estimate = truth;
  for (StampedPose& pose : estimate) {
    const double angle = Radians(degrees_per_m * pose.T_world_lidar.t.x());
    pose.T_world_lidar.q = ExpSO3(Eigen::Vector3d(angle, 0.0, 0.0));
  }
  const TrajectoryErrors e = CompareTrajectories(estimate, truth, Alignment::kFirst);
  EXPECT_NEAR(e.kitti_rrel_deg_per_m, degrees_per_m, 1e-9);
  EXPECT_NEAR(e.short_segments[0].rotation_deg_per_m, degrees_per_m, 1e-9);
  // A roll about the path turns no position.
  EXPECT_NEAR(e.kitti_trel_percent, 0.0, 1e-9);
  EXPECT_NEAR(e.rpe_rmse_deg, degrees_per_m, 1e-9);
  EXPECT_NEAR(e.ape_max_m, 0.0, 1e-9);
}

// A circle driven with a heading error that grows with the path: chord against arc, in closed form.
TEST(TrajectoryMetrics, YawDriftBendsTheSegments) {
  const double radians_per_m = 1e-3;
  const Trajectory truth = Straight(101, 1.0);
  Trajectory estimate;
  for (int i = 0; i <= 100; ++i) {
    const double a = radians_per_m * i;
    estimate.push_back(
        {i * kPeriodNs, SE3(ExpSO3(Eigen::Vector3d(0, 0, a)),
                            Eigen::Vector3d(std::sin(a), 1.0 - std::cos(a), 0.0) / radians_per_m)});
  }
  const TrajectoryErrors e = CompareTrajectories(estimate, truth, Alignment::kFirst);
  const double a = 20.0 * radians_per_m;
  const double off =
      std::hypot(std::sin(a) / radians_per_m - 20.0, (1.0 - std::cos(a)) / radians_per_m);
  EXPECT_NEAR(e.short_segments[2].translation_percent, 100.0 * off / 20.0, 1e-9);
}

TEST(TrajectoryMetrics, RelativeErrorsDoNotDependOnTheWorldFrame) {
  std::mt19937 random(2);
  const Trajectory truth = Wandering(&random, 500);
  const Trajectory estimate = Noisy(truth, &random);
  const Trajectory elsewhere = Moved(TwistExp(RandomTwist(&random, 1.0, 1000.0)), estimate);
  for (const Alignment alignment : {Alignment::kSe3, Alignment::kFirst}) {
    const TrajectoryErrors a = CompareTrajectories(estimate, truth, alignment);
    const TrajectoryErrors b = CompareTrajectories(elsewhere, truth, alignment);
    EXPECT_NEAR(a.ape_rmse_m, b.ape_rmse_m, 1e-8);
    EXPECT_NEAR(a.rpe_rmse_m, b.rpe_rmse_m, 1e-8);
    EXPECT_NEAR(a.kitti_trel_percent, b.kitti_trel_percent, 1e-8);
    EXPECT_GT(a.ape_rmse_m, 0.01);
  }
  EXPECT_GT(CompareTrajectories(elsewhere, truth, Alignment::kNone).ape_rmse_m, 100.0);
}

TEST(TrajectoryMetrics, LeastSquaresAlignmentIsTheBestOfItsNeighbours) {
  std::mt19937 random(3);
  const Trajectory truth = Wandering(&random, 200);
  const Trajectory estimate =
      Moved(TwistExp(RandomTwist(&random, 1.0, 10.0)), Noisy(truth, &random));
  const SE3 T = AlignTrajectories(estimate, truth, Alignment::kSe3);
  const auto rmse = [&](const SE3& A) {
    return CompareTrajectories(Moved(A, estimate), truth, Alignment::kNone).ape_rmse_m;
  };
  const double best = rmse(T);
  EXPECT_NEAR(best, CompareTrajectories(estimate, truth, Alignment::kSe3).ape_rmse_m, 1e-9);
  for (int i = 0; i < 100; ++i) {
    // About the middle of the path, so that rotation does not just swing it far away.
    const SE3 middle(Eigen::Quaterniond::Identity(), truth[100].T_world_lidar.t);
    const SE3 nudge = middle * TwistExp(RandomTwist(&random, 1e-3, 1e-2)) * middle.Inverse();
    EXPECT_GT(rmse(nudge * T), best);
  }
}

TEST(TrajectoryMetrics, LeastSquaresAlignmentNeverMirrors) {
  std::mt19937 random(4);
  const Trajectory truth = Wandering(&random, 100);
  Trajectory mirrored = truth;
  for (StampedPose& pose : mirrored) pose.T_world_lidar.t.z() *= -1.0;
  const SE3 T = AlignTrajectories(mirrored, truth, Alignment::kSe3);
  EXPECT_NEAR(T.R().determinant(), 1.0, 1e-12);
  // Straight and standing paths leave the rotation open, not the result.
  for (const Trajectory& flat : {Straight(50, 1.0), Straight(50, 0.0)}) {
    EXPECT_LT(CompareTrajectories(flat, flat, Alignment::kSe3).ape_max_m, 1e-12);
  }
}

TEST(TrajectoryMetrics, FirstAlignmentMakesTheFirstPosesEqual) {
  std::mt19937 random(5);
  const Trajectory truth = Wandering(&random, 10);
  const Trajectory estimate = Noisy(truth, &random);
  const SE3 T = AlignTrajectories(estimate, truth, Alignment::kFirst);
  const SE3 start = T * estimate[0].T_world_lidar;
  EXPECT_LT((start.t - truth[0].T_world_lidar.t).norm(), 1e-9);
  EXPECT_LT(RotationAngle(start, truth[0].T_world_lidar), 1e-9);
}

TEST(TrajectoryMetrics, RefusesWhatCannotBeCompared) {
  EXPECT_THROW(CompareTrajectories({}, {}, Alignment::kSe3), InputError);
  EXPECT_THROW(CompareTrajectories(Straight(1, 1), Straight(1, 1), Alignment::kSe3), InputError);
  try {
    CompareTrajectories(Straight(5, 1), Straight(7, 1), Alignment::kSe3);
    FAIL() << "5 poses against 7 were accepted";
  } catch (const InputError& error) {
    EXPECT_NE(std::string(error.what()).find("5 poses in the estimate, 7"), std::string::npos)
        << error.what();
  }
}

TEST(MatchByStamp, KeepsPairsWithinTheTolerance) {
  Trajectory truth = Straight(10, 1.0);
  Trajectory estimate = Straight(10, 1.0);
  estimate.erase(estimate.begin() + 4);
  for (StampedPose& pose : estimate) pose.stamp_ns += 9000000;
  estimate[7].stamp_ns += 2000000;  // 11 ms off: beyond the tolerance
  MatchByStamp(0.01, &estimate, &truth);
  ASSERT_EQ(estimate.size(), 8U);
  ASSERT_EQ(truth.size(), 8U);
  for (size_t i = 0; i < 8; ++i) {
    EXPECT_EQ(estimate[i].T_world_lidar.t, truth[i].T_world_lidar.t);
    EXPECT_EQ(estimate[i].stamp_ns - truth[i].stamp_ns, 9000000);
  }
}

TEST(MatchByStamp, TheNearestWinsAndOrderIsMended) {
  Trajectory truth{{1000, Position(1, 0, 0)}, {2000, Position(2, 0, 0)}};
  Trajectory estimate{{2100, Position(5, 0, 0)},
                      {1400, Position(6, 0, 0)},
                      {900, Position(7, 0, 0)},
                      {1010, Position(8, 0, 0)}};
  MatchByStamp(500e-9, &estimate, &truth);
  ASSERT_EQ(estimate.size(), 2U);
  EXPECT_EQ(estimate[0].stamp_ns, 1010);
  EXPECT_EQ(truth[0].stamp_ns, 1000);
  EXPECT_EQ(estimate[1].stamp_ns, 2100);
  EXPECT_EQ(truth[1].stamp_ns, 2000);
}

TEST(MatchByStamp, NothingInCommonLeavesNothing) {
  Trajectory truth = Straight(10, 1.0);
  Trajectory estimate = Straight(10, 1.0);
  for (StampedPose& pose : estimate) pose.stamp_ns += 50000000000;
  MatchByStamp(0.01, &estimate, &truth);
  EXPECT_TRUE(estimate.empty());
  EXPECT_TRUE(truth.empty());
  truth = Straight(3, 1.0);
  MatchByStamp(0.01, &estimate, &truth);
  EXPECT_TRUE(truth.empty());
}

Trajectory ReadPoses(const std::string& path) {
  std::ifstream file(path);
  Trajectory trajectory;
  Eigen::Matrix<double, 3, 4> M;
  for (;;) {
    for (int k = 0; k < 12; ++k) file >> M(k / 4, k % 4);
    if (!file) return trajectory;
    trajectory.push_back({static_cast<StampNs>(trajectory.size()),
                          SE3(Eigen::Matrix3d(M.leftCols<3>()), Eigen::Vector3d(M.col(3)))});
  }
}

// Figures of an independent implementation in numpy for real trajectories.
TEST(TrajectoryMetrics, AgreesWithAnIndependentJudgeOnARealDrive) {
  const char* recordings = std::getenv("LAMINA_RECORDINGS");
  if (recordings == nullptr) GTEST_SKIP() << "LAMINA_RECORDINGS names no folder of recordings";
  const std::string drive = std::string(recordings) + "/kitti_raw_0005_first70/";
  const Trajectory truth = ReadPoses(drive + "poses_reference.txt");
  ASSERT_EQ(truth.size(), 70U);
  struct Expected {
    const char* name;
    double percent_10, degrees_10, percent_20, degrees_20, ape, ape_max;
  };
  const std::vector<Expected> judged{
      {"kiss_raw.txt", 0.769, 0.0120, 0.351, 0.0068, 0.0528, 0.1407},
      {"small_vgicp_model_deskewed.txt", 0.117, 0.0012, 0.088, 0.0006, 0.0071, 0.0175},
      {"small_gicp_raw.txt", 0.703, 0.0145, 0.444, 0.0112, 0.0540, 0.1685},
      {"../poses_oxts.txt", 4.997, 0.0172, 2.951, 0.0150, 0.2889, 0.7467},
  };
  for (const Expected& expected : judged) {
    SCOPED_TRACE(expected.name);
    const TrajectoryErrors e =
        CompareTrajectories(ReadPoses(drive + "peers/" + expected.name), truth, Alignment::kSe3);
    EXPECT_NEAR(e.short_segments[1].translation_percent, expected.percent_10, 5.01e-4);
    EXPECT_NEAR(e.short_segments[1].rotation_deg_per_m, expected.degrees_10, 5.01e-5);
    EXPECT_NEAR(e.short_segments[2].translation_percent, expected.percent_20, 5.01e-4);
    EXPECT_NEAR(e.short_segments[2].rotation_deg_per_m, expected.degrees_20, 5.01e-5);
    EXPECT_NEAR(e.ape_rmse_m, expected.ape, 5.01e-5);
    EXPECT_NEAR(e.ape_max_m, expected.ape_max, 5.01e-5);
  }
}

}  // namespace
}  // namespace lamina
