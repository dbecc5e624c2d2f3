// Two scans of one room from two places, by every pairwise method; and what no method can do.
#include "frontend/pairwise/pairwise_registration.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <set>
#include <string>
#include <vector>

#include "core/base/parallel.h"
#include "frontend/pairwise/fast_global_registration.h"
#include "frontend/pairwise/maximum_clique.h"
#include "frontend/pairwise/teaser.h"

namespace lamina {
namespace {

using testing::HasSubstr;
using Points = std::vector<Eigen::Vector3f>;

// Points on a rectangle, `across` and `along` its edges.
void AddRectangle(const Eigen::Vector3d& corner, const Eigen::Vector3d& across,
                  const Eigen::Vector3d& along, double spacing_m, std::mt19937* random,
                  Points* points) {
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  std::normal_distribution<double> noise(0.0, 0.005);
  const Eigen::Vector3d normal = across.cross(along).normalized();
  const auto count = static_cast<int>(across.norm() * along.norm() / (spacing_m * spacing_m));
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector3d p =
        corner + uniform(*random) * across + uniform(*random) * along + noise(*random) * normal;
    points->push_back(p.cast<float>());
  }
}

void AddBox(const Eigen::Vector3d& low, const Eigen::Vector3d& size, double spacing_m,
            std::mt19937* random, Points* points) {
  for (int axis = 0; axis < 3; ++axis) {
    const Eigen::Vector3d a = size((axis + 1) % 3) * Eigen::Vector3d::Unit((axis + 1) % 3);
    const Eigen::Vector3d b = size((axis + 2) % 3) * Eigen::Vector3d::Unit((axis + 2) % 3);
    AddRectangle(low, a, b, spacing_m, random, points);
    AddRectangle(low + size(axis) * Eigen::Vector3d::Unit(axis), a, b, spacing_m, random, points);
  }
}

// A room with boxes in it, sampled anew for each seed, as seen from `T_world_sensor`.
Points RoomFrom(const SE3& T_world_sensor, unsigned seed) {
  std::mt19937 random(seed);
  Points world;
  AddBox({-5, -4, -1.5}, {10, 8, 3}, 0.12, &random, &world);
  AddBox({2, 1.5, -1.5}, {1.2, 0.8, 1.9}, 0.08, &random, &world);
  AddBox({-3.5, -2.5, -1.5}, {0.7, 2.1, 1.0}, 0.08, &random, &world);
  AddBox({-1, 2.8, -1.5}, {2.0, 0.5, 0.7}, 0.08, &random, &world);
  AddBox({3.8, -3.2, -1.5}, {0.6, 0.6, 2.4}, 0.08, &random, &world);
  AddBox({0.3, -2.9, -0.8}, {1.4, 0.7, 0.1}, 0.08, &random, &world);
  const SE3 T = T_world_sensor.Inverse();
  Points points;
  for (const Eigen::Vector3f& p : world) points.push_back((T * p.cast<double>()).cast<float>());
  return points;
}

PairwiseCloud Prepared(const PairwiseMethod& method, const Points& points, double voxel_m = 0.1) {
  PairwiseCloud cloud;
  cloud.points = Downsample(points, voxel_m);
  method.Prepare(&cloud);
  return cloud;
}

SE3 Motion(double angle_rad, const Eigen::Vector3d& t) {
  return SE3(ExpSO3(angle_rad * Eigen::Vector3d(0.2, -0.1, 1.0).normalized()), t);
}

class EveryMethod : public testing::TestWithParam<PairwiseKind> {};

TEST_P(EveryMethod, FindsTheMotionBetweenTwoScans) {
  const bool global = IsGlobal(GetParam());
  const SE3 truth = global ? Motion(1.2, {1.5, -0.8, 0.1}) : Motion(0.06, {0.15, -0.1, 0.03});
  const auto method = MakePairwiseMethod(GetParam(), {});
  const PairwiseCloud target = Prepared(*method, RoomFrom(SE3(), 1));
  const PairwiseCloud source = Prepared(*method, RoomFrom(truth, 2));
  const PairwiseResult result = method->Register(source, target, SE3());
  ASSERT_TRUE(result.good) << result.reason;
  // Features stand on a grid of 0.3 m; the others end at the noise.
  EXPECT_LT((result.T_target_source.t - truth.t).norm(), global ? 0.12 : 0.025);
  EXPECT_LT(RotationAngle(result.T_target_source, truth), global ? 0.04 : 0.006);
}

TEST_P(EveryMethod, GivesTheSameBitsAgain) {
  const auto method = MakePairwiseMethod(GetParam(), {});
  const auto once = [&] {
    const PairwiseCloud target = Prepared(*method, RoomFrom(SE3(), 1));
    const PairwiseCloud source = Prepared(*method, RoomFrom(Motion(0.05, {0.1, 0, 0}), 2));
    return method->Register(source, target, SE3()).T_target_source;
  };
  const SE3 a = once(), b = once();
  EXPECT_EQ(a.t, b.t);
  EXPECT_EQ(a.q.coeffs(), b.q.coeffs());
}

INSTANTIATE_TEST_SUITE_P(, EveryMethod,
                         testing::Values(PairwiseKind::kIcpPoint, PairwiseKind::kIcpPlane,
                                         PairwiseKind::kGicp, PairwiseKind::kNdt,
                                         PairwiseKind::kVgicp, PairwiseKind::kTeaser,
                                         PairwiseKind::kFgr),
                         [](const auto& kind) {
                           return PairwiseNames()[static_cast<std::size_t>(kind.param)];
                         });

TEST(PairwiseRegistration, FeatureMethodsRefuseASceneOfOnePlane) {
  std::mt19937 random(3);
  Points plane;
  AddRectangle({-10, -10, -1.5}, {20, 0, 0}, {0, 20, 0}, 0.1, &random, &plane);
  for (const PairwiseKind kind : {PairwiseKind::kTeaser, PairwiseKind::kFgr}) {
    const auto method = MakePairwiseMethod(kind, {});
    const PairwiseCloud cloud = Prepared(*method, plane);
    const PairwiseResult result = method->Register(cloud, cloud, SE3());
    EXPECT_FALSE(result.good);
    EXPECT_THAT(result.reason, HasSubstr("do not face all directions"));
  }
}

TEST(PairwiseRegistration, GlobalMethodsRefuseScansThatShareNothing) {
  std::mt19937 random(4);
  std::uniform_real_distribution<float> uniform(-8.0F, 8.0F);
  const auto cloud_of_noise = [&] {
    Points points;
    for (int i = 0; i < 4000; ++i) {
      points.emplace_back(uniform(random), uniform(random), 0.3F * uniform(random));
    }
    return points;
  };
  for (const PairwiseKind kind : {PairwiseKind::kTeaser, PairwiseKind::kFgr}) {
    const auto method = MakePairwiseMethod(kind, {});
    const PairwiseCloud a = Prepared(*method, cloud_of_noise());
    const PairwiseCloud b = Prepared(*method, cloud_of_noise());
    const PairwiseResult result = method->Register(a, b, SE3());
    EXPECT_FALSE(result.good);
    EXPECT_THAT(result.reason, HasSubstr("matches agree"));
  }
}

TEST(PairwiseRegistration, LocalMethodsSayWhenScansDoNotMeet) {
  for (const PairwiseKind kind : {PairwiseKind::kIcpPoint, PairwiseKind::kVgicp}) {
    const auto method = MakePairwiseMethod(kind, {});
    const PairwiseCloud a = Prepared(*method, RoomFrom(SE3(), 1));
    const SE3 far(Eigen::Matrix3d(Eigen::Matrix3d::Identity()), Eigen::Vector3d(500, 0, 0));
    EXPECT_FALSE(method->Register(a, a, far).good) << PairwiseNames()[static_cast<size_t>(kind)];
  }
}

TEST(PairwiseRegistration, DownsamplingKeepsTheMeanOfEachVoxel) {
  const Points points = {{0.01F, 0.0F, 0.0F}, {0.03F, 0.02F, 0.0F}, {1.0F, 1.0F, 1.0F}};
  const Points kept = Downsample(points, 0.1);
  ASSERT_EQ(kept.size(), 2U);
  EXPECT_LT((kept[0] - Eigen::Vector3f(0.02F, 0.01F, 0.0F)).norm(), 1e-6F);
  EXPECT_EQ(kept[1], points[2]);
}

TEST(PairwiseRegistration, OverlapIsTheShareOfPointsThatMeet) {
  Points target, source;
  for (int i = 0; i < 100; ++i) {
    target.emplace_back(static_cast<float>(i), 0.0F, 0.0F);
    source.emplace_back(static_cast<float>(i) + 60.0F, 0.0F, 0.0F);
  }
  const double share = OverlapShare(source, target, SE3(), 0.3);
  EXPECT_NEAR(share, 0.4, 1e-9);
  SE3 back;
  back.t.x() = -60.0;
  EXPECT_NEAR(OverlapShare(source, target, back, 0.3), 1.0, 1e-9);
}

TEST(MaximumClique, IsFoundAmongRandomEdges) {
  std::mt19937 random(5);
  std::uniform_real_distribution<double> uniform(0.0, 1.0);
  const std::set<std::size_t> planted = {3, 17, 20, 41, 55, 56, 78, 90, 91, 99};
  std::vector<std::pair<std::size_t, std::size_t>> edges;
  for (std::size_t i = 0; i < 100; ++i) {
    for (std::size_t j = i + 1; j < 100; ++j) {
      const bool both = planted.count(i) + planted.count(j) == 2;
      if (both || uniform(random) < 0.2) edges.emplace_back(i, j);
    }
  }
  EXPECT_THAT(MaximumClique(100, edges), testing::ElementsAreArray(planted));
  EXPECT_TRUE(MaximumClique(0, {}).empty());
  EXPECT_EQ(MaximumClique(5, {}).size(), 1U);
}

// Matches of a known motion, a share of them wrong.
std::vector<FeatureMatch> Matches(const SE3& truth, int count, double wrong, double noise_m) {
  std::mt19937 random(6);
  std::uniform_real_distribution<double> uniform(-10.0, 10.0);
  std::normal_distribution<double> normal;
  const auto vector = [&](auto& distribution) {
    return Eigen::Vector3d(distribution(random), distribution(random), distribution(random));
  };
  std::vector<FeatureMatch> matches;
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector3d p = vector(uniform);
    const bool bad = i < wrong * count;
    matches.push_back({p, bad ? vector(uniform) : truth * p + noise_m * vector(normal)});
  }
  return matches;
}

TEST(Teaser, EndsAtTheTruthAmongFourTimesAsManyWrongMatches) {
  const SE3 truth = Motion(2.5, {4, -3, 1});
  const PairwiseResult result = SolveTeaser(Matches(truth, 200, 0.8, 0.02), 0.1, 12);
  ASSERT_TRUE(result.good) << result.reason;
  EXPECT_GE(result.inliers, 38);
  EXPECT_LT((result.T_target_source.t - truth.t).norm(), 0.03);
  EXPECT_LT(RotationAngle(result.T_target_source, truth), 0.004);
}

TEST(Teaser, RefusesWrongMatchesAlone) {
  EXPECT_FALSE(SolveTeaser(Matches(SE3(), 200, 1.0, 0.02), 0.1, 12).good);
  EXPECT_FALSE(SolveTeaser({}, 0.1, 12).good);
}

TEST(Teaser, AdaptiveVotingTakesTheMeanOfTheLargestGroup) {
  EXPECT_NEAR(VoteAdaptively({5.0, 5.1, 4.9, 9.0, -3.0, 1.0}, 0.3), 5.0, 1e-12);
  EXPECT_NEAR(VoteAdaptively({7.0}, 0.3), 7.0, 1e-12);
}

TEST(FastGlobal, EndsAtTheTruthAmongWrongMatches) {
  const SE3 truth = Motion(1.5, {4, -3, 1});
  const std::vector<FeatureMatch> matches = Matches(truth, 300, 0.5, 0.02);
  const std::vector<FeatureMatch> passed = TupleTest(matches);
  const PairwiseResult result = SolveFastGlobal(passed, 0.1, 12);
  ASSERT_TRUE(result.good) << result.reason;
  EXPECT_LT((result.T_target_source.t - truth.t).norm(), 0.02);
  EXPECT_LT(RotationAngle(result.T_target_source, truth), 0.003);
}

TEST(FastGlobal, TheTupleTestThrowsOutMatchesThatFitNoOthers) {
  const std::vector<FeatureMatch> matches = Matches(SE3(), 300, 0.5, 0.0);
  std::size_t wrong = 0;
  const std::vector<FeatureMatch> passed = TupleTest(matches);
  for (const FeatureMatch& m : passed) wrong += (m.target - m.source).norm() > 1e-9 ? 1 : 0;
  EXPECT_GT(passed.size() - wrong, 140U);
  EXPECT_LT(wrong, 90U);
  EXPECT_FALSE(SolveFastGlobal(TupleTest(Matches(SE3(), 200, 1.0, 0.0)), 0.1, 12).good);
}

}  // namespace
}  // namespace lamina
