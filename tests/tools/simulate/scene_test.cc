#include "tools/simulate/scene.h"
#include "core/base/angle.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "core/base/error.h"
#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

using testing::AllOf;
using testing::HasSubstr;

class SimulatedScenes : public testing::TestWithParam<SceneGenerator> {
 protected:
  SimulationOptions Options() const {
    SimulationOptions options;
    options.generator = GetParam();
    options.poses = 9;
    options.planes = 7;
    options.points = 25;
    return options;
  }
};

INSTANTIATE_TEST_SUITE_P(Generators, SimulatedScenes,
                         testing::Values(SceneGenerator::kFerrer, SceneGenerator::kBalm2),
                         [](const auto& test) {
                           return SceneGeneratorNames()[static_cast<std::size_t>(test.param)];
                         });

// Whether all that a solver gets is the same, bit by bit.
void ExpectSame(const BundleProblem& a, const BundleProblem& b) {
  ASSERT_EQ(a.poses.size(), b.poses.size());
  for (std::size_t k = 0; k < a.poses.size(); ++k) {
    EXPECT_EQ(a.poses[k].q.coeffs(), b.poses[k].q.coeffs());
    EXPECT_EQ(a.poses[k].t, b.poses[k].t);
  }
  ASSERT_EQ(a.observations.size(), b.observations.size());
  for (std::size_t i = 0; i < a.observations.size(); ++i) {
    const PlaneObservation &x = a.observations[i], &y = b.observations[i];
    EXPECT_EQ(x.frame, y.frame);
    EXPECT_EQ(x.cluster.count, y.cluster.count);
    EXPECT_EQ(x.cluster.mean, y.cluster.mean);
    EXPECT_EQ(x.cluster.scatter.Dense(), y.cluster.scatter.Dense());
  }
}

TEST_P(SimulatedScenes, PointsWithoutNoiseLieOnTheirPlanes) {
  SimulationOptions options = Options();
  options.noise_m = 0.0;
  const SimulatedScene scene = MakeSimulatedScene(options, 3, true);
  ASSERT_EQ(scene.problem.planes.size(), 7U);
  for (std::size_t p = 0; p < scene.patches.size(); ++p) {
    const Plane& plane = scene.problem.planes[p];
    const PlanePatch& patch = scene.patches[p];
    EXPECT_EQ(plane.count, options.poses);
    EXPECT_EQ(plane.weight, 1.0);
    for (int i = plane.first; i < plane.first + plane.count; ++i) {
      const auto o = static_cast<std::size_t>(i);
      const int frame = scene.problem.observations[o].frame;
      EXPECT_EQ(scene.problem.observations[o].cluster.count, 25.0);
      ASSERT_EQ(scene.problem.points[o].size(), 25U);
      for (const WeightedPoint& seen : scene.problem.points[o]) {
        const Eigen::Vector3d local =
            patch.axes.transpose() *
            (scene.truth[static_cast<std::size_t>(frame)] * seen.p - patch.centre);
        EXPECT_LT(std::abs(local.z()), 1e-13);
        EXPECT_LE(local.head<2>().cwiseAbs().maxCoeff(), 0.5 * patch.side_m + 1e-13);
      }
    }
  }
}

TEST_P(SimulatedScenes, NoiseIsGaussianAndTheWeightItsInverseVariance) {
  SimulationOptions options = Options();
  options.points = 1000;
  options.noise_m = 0.02;
  const SimulatedScene scene = MakeSimulatedScene(options, 4, true);
  double square = 0.0, fourth = 0.0, count = 0.0;
  for (std::size_t p = 0; p < scene.patches.size(); ++p) {
    const Plane& plane = scene.problem.planes[p];
    EXPECT_DOUBLE_EQ(plane.weight, 2500.0);
    for (int i = plane.first; i < plane.first + plane.count; ++i) {
      const auto o = static_cast<std::size_t>(i);
      const auto frame = static_cast<std::size_t>(scene.problem.observations[o].frame);
      for (const WeightedPoint& seen : scene.problem.points[o]) {
        const Eigen::Vector3d world = scene.truth[frame] * seen.p;
        const double z =
            scene.patches[p].axes.col(2).dot(world - scene.patches[p].centre) / options.noise_m;
        square += z * z;
        fourth += z * z * z * z;
        count += 1.0;
      }
    }
  }
  EXPECT_NEAR(square / count, 1.0, 0.03);
  EXPECT_NEAR(fourth / count, 3.0, 0.2);
}

TEST_P(SimulatedScenes, StartErrorsAreThoseAskedFor) {
  SimulationOptions options = Options();
  options.start_deg = 7.0;
  options.start_m = 0.3;
  const SimulatedScene scene = MakeSimulatedScene(options, 5, false);
  ASSERT_EQ(scene.truth.size(), 9U);
  EXPECT_TRUE(scene.problem.hold_first_pose);
  EXPECT_EQ(scene.problem.poses[0].t, scene.truth[0].t);
  EXPECT_EQ(scene.problem.poses[0].q.coeffs(), scene.truth[0].q.coeffs());
  for (std::size_t k = 1; k < scene.truth.size(); ++k) {
    EXPECT_NEAR(RotationAngle(scene.problem.poses[k], scene.truth[k]) / kDegree, 7.0, 1e-9);
    EXPECT_NEAR((scene.problem.poses[k].t - scene.truth[k].t).norm(), 0.3, 1e-12);
  }
}

TEST_P(SimulatedScenes, TheSeedAloneMakesTheScene) {
  SimulationOptions options = Options();
  options.visibility = 0.6;
  SimulatedScene first, second;
  {
    const ThreadLimit limit(1);
    first = MakeSimulatedScene(options, 6, false);
  }
  {
    const ThreadLimit limit(4);
    second = MakeSimulatedScene(options, 6, true);
  }
  ExpectSame(first.problem, second.problem);
  EXPECT_TRUE(first.problem.points.empty());
  EXPECT_EQ(second.problem.points.size(), second.problem.observations.size());
  const SimulatedScene other = MakeSimulatedScene(options, 7, false);
  EXPECT_NE(other.problem.poses[1].t, first.problem.poses[1].t);
  EXPECT_NE(other.patches[0].centre, first.patches[0].centre);
}

TEST_P(SimulatedScenes, NoiseAndStartErrorLeaveTheRestAsItWas) {
  SimulationOptions options = Options();
  const SimulatedScene before = MakeSimulatedScene(options, 8, true);
  options.noise_m = 0.0;
  options.start_deg = 0.0;
  options.start_m = 0.0;
  const SimulatedScene after = MakeSimulatedScene(options, 8, true);
  for (std::size_t k = 0; k < before.truth.size(); ++k) {
    EXPECT_EQ(before.truth[k].t, after.truth[k].t);
  }
  EXPECT_EQ(before.patches[3].axes, after.patches[3].axes);
  EXPECT_LT((before.problem.points[5][2].p - after.problem.points[5][2].p).norm(), 0.06);
}

TEST_P(SimulatedScenes, EveryPlaneHasTwoObserversAndTheirShareIsTheVisibility) {
  SimulationOptions options = Options();
  options.points = 3;
  options.visibility = 0.0;
  const SimulatedScene blind = MakeSimulatedScene(options, 9, false);
  for (const Plane& plane : blind.problem.planes) {
    ASSERT_EQ(plane.count, 2);
    const auto first = static_cast<std::size_t>(plane.first);
    EXPECT_LT(blind.problem.observations[first].frame, blind.problem.observations[first + 1].frame);
  }
  options.poses = 50;
  options.planes = 200;
  options.visibility = 0.3;
  const SimulatedScene scene = MakeSimulatedScene(options, 9, false);
  EXPECT_NEAR(static_cast<double>(scene.problem.observations.size()) / (50 * 200), 0.3, 0.02);
}

TEST(SimulatedScene, GeneratorsKeepTheirBounds) {
  SimulationOptions options;
  options.generator = SceneGenerator::kBalm2;
  const SimulatedScene balm2 = MakeSimulatedScene(options, 1, false);
  for (const SE3& T : balm2.truth) {
    EXPECT_LE(RotationAngle(T, SE3()), kBalm2RotationRad);
    EXPECT_LE(T.t.norm(), kBalm2TranslationM);
  }
  for (const PlanePatch& patch : balm2.patches) {
    EXPECT_EQ(patch.side_m, 1.0);
    EXPECT_LE(patch.centre.cwiseAbs().maxCoeff(), kBalm2CubeM);
  }
  options.generator = SceneGenerator::kFerrer;
  const SimulatedScene ferrer = MakeSimulatedScene(options, 1, false);
  EXPECT_LT(RotationAngle(ferrer.truth[0], SE3()), 1e-12);
  // Equal steps along the geodesic.
  const Vector6d step = TwistLog(ferrer.truth[0].Inverse() * ferrer.truth[1]);
  for (std::size_t k = 1; k + 1 < ferrer.truth.size(); ++k) {
    const Vector6d next = TwistLog(ferrer.truth[k].Inverse() * ferrer.truth[k + 1]);
    EXPECT_LT((next - step).norm(), 1e-9);
  }
}

TEST(SimulatedScene, OptionsOutOfRangeAreNamed) {
  const auto message = [](const auto& change) -> std::string {
    SimulationOptions options;
    change(&options);
    try {
      MakeSimulatedScene(options, 1, false);
    } catch (const OptionError& error) {
      return error.what();
    }
    return "accepted";
  };
  EXPECT_THAT(message([](auto* o) { o->poses = 1; }),
              AllOf(HasSubstr("--poses = 1"), HasSubstr("[2, ")));
  EXPECT_THAT(message([](auto* o) { o->planes = -4; }), HasSubstr("--planes = -4"));
  EXPECT_THAT(message([](auto* o) { o->points = 2; }), HasSubstr("--points = 2"));
  EXPECT_THAT(message([](auto* o) { o->noise_m = std::nan(""); }), HasSubstr("--noise-m = nan"));
  EXPECT_THAT(message([](auto* o) { o->start_deg = 181; }), HasSubstr("--start-deg = 181"));
  EXPECT_THAT(message([](auto* o) { o->start_m = -0.1; }), HasSubstr("--start-m = -0.1"));
  EXPECT_THAT(message([](auto* o) { o->visibility = 1.5; }), HasSubstr("--visibility = 1.5"));
  EXPECT_THAT(message([](auto* o) { o->poses = 2000, o->planes = 100000; }),
              HasSubstr("2000 x 100000"));
}

}  // namespace
}  // namespace lamina
