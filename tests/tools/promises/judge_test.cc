// What a trial of an adverse scene is judged by: errors of poses, drift, covariances.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "tests/support/promises.h"
#include "tools/promises/covariance.h"
#include "tools/promises/judge.h"
#include "tools/promises/trial.h"

namespace lamina {
namespace {

using ::testing::HasSubstr;

SE3 Pose(double x, double y, double yaw) {
  return SE3(Eigen::Quaterniond(Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ())), {x, y, 0.0});
}

// A curve, estimated without error in a frame of its own.
std::vector<TrialFrame> ExactFrames() {
  const SE3 T_estimate_true = Pose(30.0, -7.0, 1.1);
  std::vector<TrialFrame> frames(40);
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const double s = static_cast<double>(i);
    frames[i].status = i == 0 ? "first" : "tracked";
    frames[i].T_world_lidar_true = Pose(s, 0.01 * s * s, 0.02 * s);
    frames[i].T_world_lidar = T_estimate_true * frames[i].T_world_lidar_true;
  }
  return frames;
}

TEST(AdverseJudge, ExactPosesInAnyFrameKeepThePromise) {
  const Verdict verdict = JudgeTrial(ExactFrames(), Within(0.1));
  EXPECT_TRUE(verdict.kept) << verdict.broken;
  EXPECT_LT(verdict.worst_m, 1e-9);
  EXPECT_LT(verdict.worst_deg, 1e-6);
  EXPECT_EQ(verdict.judged, 40u);
  EXPECT_EQ(verdict.pieces, 1u);
}

TEST(AdverseJudge, OneWrongPoseThatIsCalledTrackedBreaksIt) {
  std::vector<TrialFrame> frames = ExactFrames();
  frames[23].T_world_lidar.t.z() += 0.3;
  const Verdict verdict = JudgeTrial(frames, Within(0.1));
  EXPECT_FALSE(verdict.kept);
  EXPECT_NEAR(verdict.worst_m, 0.3, 0.02);
  EXPECT_EQ(verdict.worst_frame, 23u);
  EXPECT_THAT(verdict.broken, HasSubstr("m off"));

  // Said to be lost it is no wrong pose; where losing it is a failure it is that.
  frames[23].status = "lost";
  EXPECT_EQ(JudgeTrial(frames, Within(0.1)).broken, "1 lost");
  Promise free = Within(0.1);
  free.lost.reset();
  EXPECT_TRUE(JudgeTrial(frames, free).kept);
  frames[23].status = "degenerate";
  EXPECT_EQ(JudgeTrial(frames, Within(0.1)).broken, "1 degenerate");
  free.degenerate = 1;
  const Verdict kept = JudgeTrial(frames, free);
  EXPECT_TRUE(kept.kept);
  EXPECT_TRUE(std::isnan(kept.error_m[23]));
  EXPECT_LT(kept.error_m[24], 1e-9);
}

TEST(AdverseJudge, WrongTurnsCountWhereNothingMoves) {
  std::vector<TrialFrame> frames = ExactFrames();
  for (TrialFrame& frame : frames) frame.T_world_lidar_true.t.setZero();
  for (TrialFrame& frame : frames) frame.T_world_lidar = frame.T_world_lidar_true;
  EXPECT_TRUE(JudgeTrial(frames, Within(0.1)).kept);
  frames[10].T_world_lidar = frames[10].T_world_lidar * Pose(0.0, 0.0, 0.02);
  const Verdict verdict = JudgeTrial(frames, Within(0.1));
  EXPECT_NEAR(verdict.worst_deg, 1.15, 0.05);
  EXPECT_THAT(verdict.broken, HasSubstr("deg off"));
}

TEST(AdverseJudge, DriftIsThatOverStretchesOfAHundredMetres) {
  std::vector<TrialFrame> frames(200);
  for (std::size_t i = 0; i < frames.size(); ++i) {
    frames[i].status = "tracked";
    frames[i].T_world_lidar_true = Pose(2.0 * static_cast<double>(i), 0.0, 0.0);
    frames[i].T_world_lidar = Pose(2.02 * static_cast<double>(i), 0.0, 0.0);
  }
  Promise promise = Within(std::numeric_limits<double>::infinity());
  promise.drift_percent = 1.1;
  const Verdict verdict = JudgeTrial(frames, promise);
  EXPECT_TRUE(verdict.kept) << verdict.broken;
  EXPECT_NEAR(verdict.drift_percent, 1.0, 1e-6);
  promise.drift_percent = 0.9;
  EXPECT_EQ(JudgeTrial(frames, promise).broken, "1.00 % drift");
}

TEST(AdverseJudge, EachPieceHasAFrameOfItsOwn) {
  std::vector<TrialFrame> frames = ExactFrames();
  for (std::size_t i = 20; i < frames.size(); ++i) {
    frames[i].T_world_lidar = Pose(5.0, 0.0, 0.3) * frames[i].T_world_lidar;
  }
  EXPECT_GT(JudgeTrial(frames, Within(0.1)).worst_m, 1.0);
  for (std::size_t i = 20; i < frames.size(); ++i) frames[i].piece = 1;
  EXPECT_EQ(JudgeTrial(frames, Within(0.1)).broken, "2 pieces");
  Promise free = Within(0.1);
  free.lost.reset();
  EXPECT_TRUE(JudgeTrial(frames, free).kept);
}

// Errors drawn from the covariance that is reported, times a factor.
std::vector<TrialFrame> FramesWithErrors(double factor_along_x) {
  std::mt19937 random(1);
  std::normal_distribution<double> normal(0.0, 1.0);
  std::vector<TrialFrame> frames = ExactFrames();
  frames.resize(4000, frames.back());
  Vector6d sigma;
  sigma << 1e-3, 2e-3, 1e-3, 0.01, 0.02, 0.03;
  for (TrialFrame& frame : frames) {
    frame.status = "tracked";
    Vector6d error;
    for (int i = 0; i < 6; ++i) error[i] = sigma[i] * normal(random);
    error[3] *= factor_along_x;
    frame.T_world_matched = Retract(frame.T_world_lidar, error);
    frame.covariance = sigma.cwiseAbs2().asDiagonal();
  }
  return frames;
}

TEST(AdverseCovariance, IsOneWhereItIsHonest) {
  const CovarianceCheck honest = CheckCovariance(FramesWithErrors(1.0));
  EXPECT_EQ(honest.pairs, 3999u);
  EXPECT_NEAR(honest.nees_per_dof, 1.0, 0.03);
  EXPECT_NEAR(honest.worst_ratio, 1.0, 0.1);
  const CovarianceCheck too_sure = CheckCovariance(FramesWithErrors(5.0));
  EXPECT_NEAR(too_sure.nees_per_dof, (25.0 + 5.0) / 6.0, 0.3);
  EXPECT_NEAR(too_sure.worst_ratio, 5.0, 0.3);
  EXPECT_TRUE(std::isnan(CheckCovariance({}).worst_ratio));
}

}  // namespace
}  // namespace lamina
