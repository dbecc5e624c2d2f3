// What every formulation of bundle adjustment must do, whatever its formula.
#include <gtest/gtest.h>

#include <Eigen/LU>

#include <stdexcept>

#include "backend/bundle/formulations/eigen_factors.h"
#include "backend/bundle/formulations/huang_cost.h"
#include "backend/bundle/formulations/registry.h"
#include "backend/bundle/solver/adjuster.h"
#include "tests/support/scenes/random_bundles.h"

namespace lamina {
namespace {

BundleScene FormulationScene(BundleSceneOptions options, unsigned seed) {
  Draws draws(seed);
  BundleScene scene = MakeBundleScene(options, &draws);
  for (const Points& points : scene.points) {
    scene.problem.points.emplace_back();
    for (const Eigen::Vector3d& p : points) scene.problem.points.back().push_back({p, 1.0});
  }
  return scene;
}

BundleSceneOptions Noisy() {
  BundleSceneOptions options;
  options.poses = 5;
  options.planes = 8;
  options.points = 12;
  options.seen_share = 0.8;
  options.sigma_m = 0.03;
  options.weight = 3.0;
  return options;
}

BundleAdjusterOptions LongSolve() {
  BundleAdjusterOptions options;
  options.max_iterations = 100000;
  options.min_cost_change = 0.0;
  options.min_planes = 3;
  return options;
}

double LargestPoseError(const std::vector<SE3>& a, const std::vector<SE3>& b) {
  double largest = 0.0;
  for (std::size_t k = 0; k < a.size(); ++k) {
    largest = std::max({largest, RotationAngle(a[k], b[k]), (a[k].t - b[k].t).norm()});
  }
  return largest;
}

std::string NameOf(const ::testing::TestParamInfo<std::string>& info) { return info.param; }

class EveryFormulation : public ::testing::TestWithParam<std::string> {};

TEST_P(EveryFormulation, ReturnsTheExactPosesWithoutNoise) {
  for (unsigned seed = 0; seed < 3; ++seed) {
    BundleSceneOptions options;
    options.poses = 8;
    options.planes = 15;
    options.points = 10;
    const BundleScene scene = FormulationScene(options, seed);
    ASSERT_GT(LargestPoseError(scene.problem.poses, scene.truth), 0.09);
    const BundleResult result =
        AdjustBundle(scene.problem, LongSolve(), FindFormulation(GetParam()));
    EXPECT_TRUE(result.usable());
    // Eigen-Factors' 4x4 matrices hold squared coordinates: rounding hides the last of the way.
    EXPECT_LT(LargestPoseError(result.poses, scene.truth),
              GetParam() == "eigen_factors" ? 1e-5 : 1e-6)
        << result.iterations << " iterations, cost " << result.final_cost;
  }
}

TEST_P(EveryFormulation, FindsTheTruthBetterThanTheStart) {
  BundleSceneOptions options;
  options.sigma_m = 0.01;
  const BundleScene scene = FormulationScene(options, 7);
  BundleAdjusterOptions solve = LongSolve();
  solve.max_iterations = 3000;
  solve.min_cost_change = 1e-9;
  const BundleResult result = AdjustBundle(scene.problem, solve, FindFormulation(GetParam()));
  EXPECT_TRUE(result.usable());
  EXPECT_LT(result.final_cost, result.initial_cost);
  EXPECT_LT(LargestPoseError(result.poses, scene.truth), 0.02);
}

TEST_P(EveryFormulation, TellsTheObserverOfEveryStep) {
  const BundleScene scene = FormulationScene(Noisy(), 3);
  BundleAdjusterOptions solve = LongSolve();
  solve.max_iterations = 4;
  int steps = 0;
  double last_ms = 0.0;
  std::vector<SE3> last;
  const BundleResult result =
      AdjustBundle(scene.problem, solve, FindFormulation(GetParam()),
                   [&](const BundleStep& step, const std::vector<SE3>& poses) {
                     EXPECT_EQ(step.iteration, ++steps);
                     EXPECT_GE(step.solve_ms, last_ms);
                     last_ms = step.solve_ms;
                     last = poses;
                   });
  EXPECT_EQ(steps, result.iterations);
  EXPECT_GE(result.solve_ms, last_ms);
  EXPECT_LT(LargestPoseError(last, result.poses), 1e-12);
}

TEST_P(EveryFormulation, HasTheSameBitsAtAnyNumberOfThreads) {
  BundleSceneOptions options = Noisy();
  options.poses = 12;
  options.planes = 300;
  options.points = 6;
  const BundleScene scene = FormulationScene(options, 5);
  BundleAdjusterOptions solve = LongSolve();
  solve.max_iterations = 5;
  std::vector<SE3> first;
  for (const std::size_t threads : {1U, 2U, 4U}) {
    const ThreadLimit limit(threads);
    const BundleResult result = AdjustBundle(scene.problem, solve, FindFormulation(GetParam()));
    if (first.empty()) first = result.poses;
    EXPECT_EQ(LargestPoseError(result.poses, first), 0.0) << threads << " threads";
  }
}

TEST_P(EveryFormulation, HoldsTheFirstPose) {
  const BundleScene scene = FormulationScene(Noisy(), 4);
  const BundleResult result = AdjustBundle(scene.problem, LongSolve(), FindFormulation(GetParam()));
  EXPECT_EQ((result.poses[0].t - scene.problem.poses[0].t).norm(), 0.0);
  EXPECT_LT(RotationAngle(result.poses[0], scene.problem.poses[0]), 1e-12);
}

INSTANTIATE_TEST_SUITE_P(Formulations, EveryFormulation, ::testing::ValuesIn(FormulationNames()),
                         NameOf);

// --- Derivatives against numeric ones
// -------------------------------------------------------------

std::vector<std::string> WithNormalEquations() {
  std::vector<std::string> names;
  for (const Formulation* formulation : Formulations()) {
    if (formulation->make_cost != nullptr) names.emplace_back(formulation->name);
  }
  return names;
}

class NormalEquationsOf : public ::testing::TestWithParam<std::string> {};

// Value() judges a step from the last linearisation: that is the function to be differentiated.
TEST_P(NormalEquationsOf, GradientMeetsNumericDifferences) {
  for (unsigned seed = 0; seed < 10; ++seed) {
    const BundleScene scene = FormulationScene(Noisy(), seed);
    const std::vector<SE3>& poses = scene.problem.poses;
    const auto cost = FindFormulation(GetParam()).make_cost(scene.problem);
    Eigen::VectorXd g;
    Eigen::MatrixXd H;
    const double value = LineariseDense(scene.problem, poses, cost.get(), &g, &H);
    EXPECT_NEAR(cost->Value(poses), value, 1e-9 * value);
    Eigen::VectorXd numeric(g.size());
    constexpr double kStep = 1e-5;
    for (Eigen::Index c = 0; c < g.size(); ++c) {
      numeric(c) =
          (cost->Value(Retracted(poses, c, kStep)) - cost->Value(Retracted(poses, c, -kStep))) /
          (2.0 * kStep);
    }
    EXPECT_GT(g.norm(), 1e-3);
    EXPECT_LT((g - numeric).norm(), 1e-6 * g.norm());
  }
}

INSTANTIATE_TEST_SUITE_P(Formulations, NormalEquationsOf,
                         ::testing::ValuesIn(WithNormalEquations()), NameOf);

// Derivative of the gradient by central differences. Retract moves the tangent space along with
// the rotation, which adds the antisymmetric half of the bracket: the symmetric part is the
// Hessian.
Eigen::MatrixXd NumericHessian(const BundleProblem& problem, BundleCost* cost) {
  constexpr double kStep = 1e-5;
  Eigen::VectorXd ahead, behind;
  Eigen::MatrixXd unused, H(6 * problem.poses.size(), 6 * problem.poses.size());
  for (Eigen::Index c = 0; c < H.cols(); ++c) {
    LineariseDense(problem, Retracted(problem.poses, c, kStep), cost, &ahead, &unused);
    LineariseDense(problem, Retracted(problem.poses, c, -kStep), cost, &behind, &unused);
    H.col(c) = (ahead - behind) / (2.0 * kStep);
  }
  return 0.5 * (H + H.transpose());
}

TEST(Evm2Cost, HessianIsExact) {
  for (unsigned seed = 0; seed < 10; ++seed) {
    const BundleScene scene = FormulationScene(Noisy(), seed);
    const auto cost = FindFormulation("evm2").make_cost(scene.problem);
    Eigen::VectorXd g;
    Eigen::MatrixXd H;
    LineariseDense(scene.problem, scene.problem.poses, cost.get(), &g, &H);
    const Eigen::MatrixXd expected = NumericHessian(scene.problem, cost.get());
    EXPECT_LT((H - expected).norm(), 1e-6 * expected.norm());
  }
}

// The cost by the points alone: what Evm1Cost's Hessian is the second derivative of, poses
// entering by the first derivative of the points.
TEST(Evm1Cost, HessianIsThatOfThePointsWithLinearMotion) {
  const BundleScene scene = FormulationScene(Noisy(), 1);
  const BundleProblem& problem = scene.problem;
  const auto cost = FindFormulation("evm1").make_cost(problem);
  Eigen::VectorXd g;
  Eigen::MatrixXd H;
  LineariseDense(problem, problem.poses, cost.get(), &g, &H);
  const auto linear_cost = [&](const Eigen::VectorXd& delta) {
    double value = 0.0;
    for (const Plane& plane : problem.planes) {
      PointCluster sum;
      for (int i = plane.first; i < plane.first + plane.count; ++i) {
        const auto o = static_cast<std::size_t>(i);
        const int k = problem.observations[o].frame;
        const SE3& T = problem.poses[static_cast<std::size_t>(k)];
        const Vector6d d = delta.segment<6>(6 * k);
        for (const WeightedPoint& point : problem.points[o]) {
          const Eigen::Vector3d turned = d.head<3>().cross(point.p);
          sum.AddPoint(T * point.p + T.R() * turned + d.tail<3>());
        }
      }
      value += 0.5 * plane.weight * sum.count * sum.EigenPairs().l(2);
    }
    return value;
  };
  constexpr double kStep = 1e-3;
  Eigen::MatrixXd expected(H.rows(), H.cols());
  for (Eigen::Index r = 0; r < H.rows(); ++r) {
    for (Eigen::Index c = 0; c < H.cols(); ++c) {
      Eigen::VectorXd d = Eigen::VectorXd::Zero(H.rows());
      double sum = 0.0;
      for (const double sr : {1.0, -1.0}) {
        for (const double sc : {1.0, -1.0}) {
          d.setZero();
          d(r) += sr * kStep;
          d(c) += sc * kStep;
          sum += sr * sc * linear_cost(d);
        }
      }
      expected(r, c) = sum / (4.0 * kStep * kStep);
    }
  }
  EXPECT_LT((H - expected).norm(), 1e-4 * expected.norm());
}

TEST(HuangCost, IsThePapersSumAndItsMatrixTheGaussNewtonOne) {
  const BundleScene scene = FormulationScene(Noisy(), 2);
  const BundleProblem& problem = scene.problem;
  HuangCost cost(problem);
  Eigen::VectorXd g;
  Eigen::MatrixXd H;
  const double value = LineariseDense(problem, problem.poses, &cost, &g, &H);
  // Eq. 10 as printed, residual by residual, the planes held.
  const auto residuals = [&](const std::vector<SE3>& poses) {
    std::vector<double> r;
    for (const Plane& plane : problem.planes) {
      const PointCluster all = AggregatePlane(problem, plane, problem.poses);
      const Eigen::Vector3d normal = all.EigenPairs().u.col(2);
      for (int i = plane.first; i < plane.first + plane.count; ++i) {
        const PlaneObservation& o = problem.observations[static_cast<std::size_t>(i)];
        const SE3& T = poses[static_cast<std::size_t>(o.frame)];
        const Eigen3 e = o.cluster.EigenPairs();
        for (int k = 0; k < 2; ++k) {
          r.push_back(std::sqrt(plane.weight * o.cluster.count * e.l(k)) *
                      normal.dot(T.q * e.u.col(k)));
        }
        r.push_back(std::sqrt(plane.weight * o.cluster.count) *
                    normal.dot(T * o.cluster.mean - all.mean));
      }
    }
    return Eigen::VectorXd(Eigen::Map<Eigen::VectorXd>(r.data(), static_cast<int>(r.size())));
  };
  EXPECT_NEAR(0.5 * residuals(problem.poses).squaredNorm(), value, 1e-10 * value);
  constexpr double kStep = 1e-6;
  Eigen::MatrixXd J(residuals(problem.poses).size(), H.cols());
  for (Eigen::Index c = 0; c < H.cols(); ++c) {
    J.col(c) = (residuals(Retracted(problem.poses, c, kStep)) -
                residuals(Retracted(problem.poses, c, -kStep))) /
               (2.0 * kStep);
  }
  EXPECT_LT((H - J.transpose() * J).norm(), 1e-7 * H.norm());
}

TEST(EigenFactors, GradientMeetsNumericDifferences) {
  for (unsigned seed = 0; seed < 10; ++seed) {
    const BundleScene scene = FormulationScene(Noisy(), seed);
    const std::vector<SE3>& poses = scene.problem.poses;
    const EigenFactorsCost cost(scene.problem);
    Eigen::VectorXd g;
    cost.ValueAndGradient(poses, &g);
    Eigen::VectorXd numeric(g.size());
    constexpr double kStep = 1e-5;
    for (Eigen::Index c = 0; c < g.size(); ++c) {
      numeric(c) = (cost.ValueAndGradient(Retracted(poses, c, kStep), nullptr) -
                    cost.ValueAndGradient(Retracted(poses, c, -kStep), nullptr)) /
                   (2.0 * kStep);
    }
    EXPECT_LT((g - numeric).norm(), 1e-6 * g.norm());
  }
}

TEST(EigenFactors, SmallestEigenvalueIsTheSumOfSquaredPlaneDistances) {
  const BundleScene scene = FormulationScene(Noisy(), 3);
  const std::vector<SE3>& poses = scene.problem.poses;
  double expected = 0.0;
  for (const Plane& plane : scene.problem.planes) {
    Eigen::Matrix4d Q = Eigen::Matrix4d::Zero();
    for (const Eigen::Vector3d& x : PointsOfPlane(scene, plane, poses).world) {
      const Eigen::Vector4d q = x.homogeneous();
      Q += q * q.transpose();
    }
    // By inverse iteration: the other eigenvalues are larger by the square of extent over noise.
    const Eigen::Matrix4d inverse = Q.inverse();
    Eigen::Vector4d v = Eigen::Vector4d::Ones();
    for (int i = 0; i < 50; ++i) v = (inverse * v).normalized();
    expected += 0.5 * plane.weight * v.dot(Q * v);
  }
  EXPECT_NEAR(EigenFactorsCost(scene.problem).ValueAndGradient(poses, nullptr), expected,
              1e-9 * expected);
}

// Poses and planes together, with exact derivatives: the last digits come at once.
TEST(PlaneLandmarks, ConvergeInAFewSteps) {
  BundleSceneOptions options;
  options.poses = 8;
  options.planes = 15;
  options.points = 10;
  const BundleScene scene = FormulationScene(options, 1);
  ASSERT_GT(LargestPoseError(scene.problem.poses, scene.truth), 0.05);
  BundleAdjusterOptions solve = LongSolve();
  solve.max_iterations = 8;
  const BundleResult result =
      AdjustBundle(scene.problem, solve, FindFormulation("plane_landmarks"));
  EXPECT_LT(LargestPoseError(result.poses, scene.truth), 1e-9);
}

TEST(Formulations, AreFoundByNameAndByNoOther) {
  for (const Formulation* formulation : Formulations()) {
    EXPECT_EQ(&FindFormulation(formulation->name), formulation);
    EXPECT_TRUE((formulation->make_cost == nullptr) != (formulation->solve == nullptr))
        << formulation->name;
  }
  EXPECT_EQ(FormulationNames().size(), Formulations().size());
  EXPECT_THROW(FindFormulation("best"), std::logic_error);
}

TEST(Formulations, RefuseWhatTheyCannotExpress) {
  BundleScene scene = FormulationScene(Noisy(), 6);
  scene.problem.priors.push_back({0, 1, SE3(), Matrix6d::Identity()});
  for (const char* name : {"huang", "eigen_factors", "eigen_factors_lm", "plane_landmarks"}) {
    EXPECT_THROW(AdjustBundle(scene.problem, LongSolve(), FindFormulation(name)), std::logic_error);
  }
  EXPECT_TRUE(AdjustBundle(scene.problem, LongSolve(), FindFormulation("evm2")).usable());
  scene.problem.points.clear();
  EXPECT_THROW(AdjustBundle(scene.problem, LongSolve(), FindFormulation("evm1")), std::logic_error);
}

TEST(Formulations, CondensedAndBothSecondOrderFormsShareOneOptimum) {
  const BundleScene scene = FormulationScene(Noisy(), 8);
  const BundleResult condensed = AdjustBundle(scene.problem, LongSolve());
  for (const char* name : {"evm1", "evm2"}) {
    const BundleResult other = AdjustBundle(scene.problem, LongSolve(), FindFormulation(name));
    EXPECT_NEAR(other.final_cost, condensed.final_cost, 1e-10 * condensed.final_cost);
    EXPECT_LT(LargestPoseError(other.poses, condensed.poses), 1e-6);
  }
}

}  // namespace
}  // namespace lamina
