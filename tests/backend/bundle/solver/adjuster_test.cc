#include "backend/bundle/solver/adjuster.h"

#include <ceres/ceres.h>
#include <ceres/rotation.h>
#include <gtest/gtest.h>

#include <array>
#include <limits>

#include "core/base/angle.h"
#include "tests/support/scenes/random_bundles.h"

namespace lamina {
namespace {

using Status = BundleResult::Status;

BundleAdjusterOptions ExactSolve() {
  BundleAdjusterOptions options;
  options.max_iterations = 100;
  options.min_cost_change = 1e-14;
  options.min_planes = 3;
  return options;
}

double LargestRotation(const std::vector<SE3>& a, const std::vector<SE3>& b) {
  double largest = 0.0;
  for (std::size_t k = 0; k < a.size(); ++k) {
    largest = std::max(largest, RotationAngle(a[k], b[k]));
  }
  return largest;
}

double LargestShift(const std::vector<SE3>& a, const std::vector<SE3>& b) {
  double largest = 0.0;
  for (std::size_t k = 0; k < a.size(); ++k) largest = std::max(largest, (a[k].t - b[k].t).norm());
  return largest;
}

// Distance of one point of one frame to a plane that is a variable of its own:
// pose = [angle-axis; translation], plane = (a, b, offset), normal ~ n0 + a u1 + b u2.
struct PointOnPlane {
  const Patch& patch;
  Eigen::Vector3d point;

  template <typename T>
  bool operator()(const T* pose, const T* plane, T* residual) const {
    const std::array<T, 3> p = {T(point.x()), T(point.y()), T(point.z())};
    std::array<T, 3> world;
    ceres::AngleAxisRotatePoint(pose, p.data(), world.data());
    const Eigen::Matrix<T, 3, 1> x(world[0] + pose[3], world[1] + pose[4], world[2] + pose[5]);
    const Eigen::Matrix<T, 3, 1> normal =
        (patch.Normal().cast<T>() + plane[0] * patch.u1.cast<T>() + plane[1] * patch.u2.cast<T>())
            .normalized();
    *residual = normal.dot(x) - plane[2];
    return true;
  }
};

// The same problem, the plain way: every point a residual, every plane three variables.
std::vector<SE3> SolveWithPoints(const BundleScene& scene, double* cost) {
  std::vector<std::array<double, 6>> poses;
  for (const SE3& T : scene.problem.poses) {
    const Eigen::Vector3d w = LogSO3(T.q);
    poses.push_back({w.x(), w.y(), w.z(), T.t.x(), T.t.y(), T.t.z()});
  }
  std::vector<std::array<double, 3>> planes;
  for (const Patch& patch : scene.patches) {
    planes.push_back({0.0, 0.0, patch.Normal().dot(patch.centre)});
  }
  ceres::Problem problem;
  for (std::size_t i = 0; i < planes.size(); ++i) {
    const Plane& plane = scene.problem.planes[i];
    for (int o = plane.first; o < plane.first + plane.count; ++o) {
      const auto k =
          static_cast<std::size_t>(scene.problem.observations[static_cast<std::size_t>(o)].frame);
      for (const Eigen::Vector3d& p : scene.points[static_cast<std::size_t>(o)]) {
        problem.AddResidualBlock(new ceres::AutoDiffCostFunction<PointOnPlane, 1, 6, 3>(
                                     new PointOnPlane{scene.patches[i], p}),
                                 nullptr, poses[k].data(), planes[i].data());
      }
    }
  }
  problem.SetParameterBlockConstant(poses[0].data());
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.max_num_iterations = 200;
  options.function_tolerance = 1e-15;
  options.gradient_tolerance = 1e-14;
  options.parameter_tolerance = 1e-14;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  *cost = summary.final_cost;
  std::vector<SE3> result;
  for (const auto& x : poses) {
    result.emplace_back(ExpSO3({x[0], x[1], x[2]}), Eigen::Vector3d(x[3], x[4], x[5]));
  }
  return result;
}

TEST(BundleAdjuster, RecoversExactPosesFromNoiseFreeData) {
  for (unsigned seed = 0; seed < 5; ++seed) {
    Draws draws(seed);
    const BundleScene scene = MakeBundleScene({}, &draws);
    ASSERT_GT(LargestRotation(scene.problem.poses, scene.truth), 1.9 * kDegree);
    const BundleResult result = AdjustBundle(scene.problem, ExactSolve());
    EXPECT_TRUE(result.usable());
    EXPECT_LT(LargestRotation(result.poses, scene.truth), 1e-6);
    EXPECT_LT(LargestShift(result.poses, scene.truth), 1e-6);
    EXPECT_LT(result.final_cost, 1e-9 * result.initial_cost);
    EXPECT_LT(result.iterations, 15);
  }
}

TEST(BundleAdjuster, MeetsTheOptimumOverAllPointsWithPlanesAsVariables) {
  for (unsigned seed = 0; seed < 5; ++seed) {
    Draws draws(seed);
    BundleSceneOptions options;
    options.poses = 8;
    options.planes = 12;
    options.points = 15;
    options.seen_share = 0.7;
    options.sigma_m = 0.02;
    const BundleScene scene = MakeBundleScene(options, &draws);
    double cost = 0.0;
    const std::vector<SE3> expected = SolveWithPoints(scene, &cost);
    const BundleResult result = AdjustBundle(scene.problem, ExactSolve());
    EXPECT_TRUE(result.usable());
    EXPECT_NEAR(result.final_cost, cost, 1e-8 * cost);
    EXPECT_LT(LargestRotation(result.poses, expected), 1e-5);
    EXPECT_LT(LargestShift(result.poses, expected), 1e-5);
    // Noise moved the optimum away from the truth: two solvers agree on more than the scene.
    EXPECT_GT(LargestShift(result.poses, scene.truth), 1e-4);
  }
}

TEST(BundleAdjuster, MarginalisedWindowMeetsTheFullBatch) {
  for (unsigned seed = 0; seed < 5; ++seed) {
    Draws draws(seed);
    BundleSceneOptions options;
    options.poses = 10;
    options.sigma_m = 0.02;
    const BundleScene scene = MakeBundleScene(options, &draws);
    const BundleResult full = AdjustBundle(scene.problem, ExactSolve());
    ASSERT_TRUE(full.usable());
    BundleProblem rest = Marginalised(scene.problem, 4, full.poses);
    const std::vector<SE3> expected = rest.poses;
    for (SE3& T : rest.poses) {
      const SE3 off = draws.Offset(kDegree, 0.05);
      T = SE3(T.q * off.q, T.t + off.t);
    }
    const BundleResult result = AdjustBundle(rest, ExactSolve());
    EXPECT_TRUE(result.usable());
    EXPECT_LT(LargestRotation(result.poses, expected), 1e-5);
    EXPECT_LT(LargestShift(result.poses, expected), 1e-5);
  }
}

TEST(BundleAdjuster, HoldsTheFirstPoseOnlyWhenAsked) {
  Draws draws(1);
  BundleSceneOptions options;
  options.sigma_m = 0.02;
  BundleScene scene = MakeBundleScene(options, &draws);
  const SE3 first = scene.problem.poses[0];
  BundleResult result = AdjustBundle(scene.problem, ExactSolve());
  EXPECT_EQ((result.poses[0].t - first.t).norm(), 0.0);
  EXPECT_LT(RotationAngle(result.poses[0], first), 1e-15);
  scene.problem.hold_first_pose = false;
  result = AdjustBundle(scene.problem, ExactSolve());
  EXPECT_TRUE(result.usable());
  EXPECT_GT((result.poses[0].t - first.t).norm(), 1e-6);
}

TEST(BundleAdjuster, PriorsHoldWhatNoPlaneSees) {
  Draws draws(2);
  // All planes face up: motion along them, and the turn about their normal, is open.
  BundleProblem problem;
  problem.poses = {SE3(), SE3(ExpSO3({0.01, -0.02, 0.03}), {0.3, 0.2, 0.1})};
  const SE3 truth(ExpSO3({0.0, 0.0, 0.1}), {0.5, 0.1, 0.0});
  for (int i = 0; i < 30; ++i) {
    const Patch patch({10.0 * i, draws.Uniform(-50.0, 50.0), draws.Uniform(-5.0, 5.0)},
                      Eigen::Vector3d::UnitZ());
    Plane plane;
    plane.first = 2 * i;
    plane.count = 2;
    plane.weight = 1e4;
    for (int k = 0; k < 2; ++k) {
      Points seen;
      for (int p = 0; p < 20; ++p) {
        const Eigen::Vector3d world = patch.Point(1.0, 0.0, &draws);
        seen.push_back(k == 0 ? world : truth.Inverse() * world);
      }
      problem.observations.push_back({k, ClusterOf(seen)});
    }
    problem.planes.push_back(plane);
  }
  problem.priors.push_back({0, 1, truth, Matrix6d::Identity()});
  const BundleResult result = AdjustBundle(problem, ExactSolve());
  EXPECT_TRUE(result.usable());
  EXPECT_LT(RotationAngle(result.poses[1], truth), 1e-6);
  EXPECT_LT((result.poses[1].t - truth.t).norm(), 1e-6);
}

TEST(BundleAdjuster, RefusesTooFewPlanes) {
  Draws draws(3);
  const BundleScene scene = MakeBundleScene({}, &draws);
  BundleAdjusterOptions options;
  options.min_planes = 21;
  const BundleResult result = AdjustBundle(scene.problem, options);
  EXPECT_EQ(result.status, Status::kTooFewPlanes);
  EXPECT_FALSE(result.usable());
  EXPECT_EQ(LargestShift(result.poses, scene.problem.poses), 0.0);
  EXPECT_EQ(AdjustBundle(BundleProblem(), options).status, Status::kTooFewPlanes);
}

TEST(BundleAdjuster, SaysWhenTheIterationsRanOut) {
  Draws draws(4);
  BundleSceneOptions scene_options;
  scene_options.sigma_m = 0.01;
  const BundleScene scene = MakeBundleScene(scene_options, &draws);
  BundleAdjusterOptions options = ExactSolve();
  options.max_iterations = 1;
  const BundleResult result = AdjustBundle(scene.problem, options);
  EXPECT_EQ(result.status, Status::kIterationLimit);
  EXPECT_LT(result.final_cost, result.initial_cost);
  EXPECT_EQ(AdjustBundle(scene.problem, ExactSolve()).status, Status::kConverged);
}

TEST(BundleAdjuster, HasTheSameBitsAtAnyNumberOfThreads) {
  Draws draws(5);
  BundleSceneOptions options;
  options.planes = 400;
  options.points = 5;
  options.seen_share = 0.3;
  options.sigma_m = 0.02;
  const BundleScene scene = MakeBundleScene(options, &draws);
  std::vector<SE3> first;
  for (const std::size_t threads : {1U, 2U, 4U}) {
    const ThreadLimit limit(threads);
    const BundleResult result = AdjustBundle(scene.problem, BundleAdjusterOptions());
    if (first.empty()) first = result.poses;
    for (std::size_t k = 0; k < first.size(); ++k) {
      EXPECT_EQ(result.poses[k].t, first[k].t) << threads << " threads";
      EXPECT_EQ(result.poses[k].q.coeffs(), first[k].q.coeffs()) << threads << " threads";
    }
  }
}

// Ends, and either refuses with the start values or gives finite poses.
void ExpectToCope(const BundleProblem& problem, const char* what) {
  const BundleResult result = AdjustBundle(problem, BundleAdjusterOptions());
  ASSERT_EQ(result.poses.size(), problem.poses.size());
  for (std::size_t k = 0; k < result.poses.size() && result.usable(); ++k) {
    EXPECT_TRUE(result.poses[k].t.allFinite()) << what;
    EXPECT_TRUE(result.poses[k].q.coeffs().allFinite()) << what;
  }
}

TEST(BundleAdjuster, NonFiniteInputIsAStatus) {
  Draws draws(6);
  const BundleScene scene = MakeBundleScene({}, &draws);
  for (const double bad : {std::numeric_limits<double>::quiet_NaN(),
                           std::numeric_limits<double>::infinity(), 1e200, -1e200}) {
    for (const std::size_t at : {std::size_t{0}, scene.problem.observations.size() - 1}) {
      BundleProblem problem = scene.problem;
      problem.observations[at].cluster.mean.y() = bad;
      ExpectToCope(problem, "mean");
      problem = scene.problem;
      problem.observations[at].cluster.scatter.xy = bad;
      ExpectToCope(problem, "scatter");
      problem = scene.problem;
      problem.observations[at].cluster.count = bad;
      ExpectToCope(problem, "count");
    }
    BundleProblem problem = scene.problem;
    problem.poses[3].t.x() = bad;
    ExpectToCope(problem, "translation");
    problem = scene.problem;
    problem.poses[3].q.x() = bad;
    ExpectToCope(problem, "rotation");
    problem = scene.problem;
    problem.planes[3].weight = bad;
    ExpectToCope(problem, "weight");
  }
  BundleProblem problem = scene.problem;
  problem.poses[3].t.x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(AdjustBundle(problem, BundleAdjusterOptions()).status, Status::kFailed);
}

}  // namespace
}  // namespace lamina
