#include "frontend/matching/direction_profile.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/support/scenes/random_rooms.h"

namespace lamina {
namespace {

// A corridor along x, and boards across it that alone tell where along it the sensor is.
World WithBoards(const std::vector<double>& at_x, double moved_m) {
  World world = World::Corridor();
  for (std::size_t i = 0; i < at_x.size(); ++i) {
    const double side = i % 2 == 0 ? 1.5 : -1.5;
    world.facets.push_back({{at_x[i] + moved_m, side, 0}, {0, 0.35, 0}, {0, 0, 1.2}});
  }
  return world;
}

// Walls along x on both sides that step back and forth every four metres, and a floor: no surface
// faces x, where the steps are tells it.
World WithSteps() {
  World world;
  for (int i = -5; i < 5; ++i) {
    const double x = 4.0 * i + 2.3, step = i % 2 == 0 ? 0.6 : 0.0;
    world.facets.push_back({{x, 2.45 + step, 0}, {2, 0, 0}, {0, 0, 1.5}});
    world.facets.push_back({{x, -2.45 - step, 0}, {2, 0, 0}, {0, 0, 1.5}});
  }
  world.facets.push_back({{0.3, 0.2, -1.5}, {20, 0, 0}, {0, 3.3, 0}});
  return world;
}

class DirectionProfileTest : public testing::Test {
 protected:
  void Map(const World& world, int frames = 5) {
    FillMap(world, frames, 3000, 0.005, &draws_, &map_);
  }
  std::vector<PointCluster> Scan(const World& world) {
    return DeskewClusters(
        ScanFrom(SE3(), world.Sample(2000, 0.005, &draws_), map_.options().LeafSize()),
        SweepMotion());
  }
  DirectionProfile::Posterior Posterior(const std::vector<PointCluster>& scan, double at_m,
                                        double predicted_m, double sigma_m) {
    const SE3 T(Eigen::Quaterniond::Identity(), {at_m, 0.0, 0.0});
    return DirectionProfile(scan, map_, T, Vector6d::Unit(3)).With(predicted_m, sigma_m);
  }
  double Blocks(const std::vector<PointCluster>& scan) {
    return DirectionProfile(scan, map_, SE3(), Vector6d::Unit(3)).Blocks();
  }

  Draws draws_{3};
  VoxelMap map_{VoxelMapOptions()};
};

TEST_F(DirectionProfileTest, CountsTheBlocksThatFaceTheDirection) {
  const World few = WithBoards({5.2}, 0.0);
  Map(few);
  EXPECT_LT(Blocks(Scan(few)), 2.5);
  map_ = VoxelMap(VoxelMapOptions());
  const World many = WithBoards({-17.2, -13.1, -9.2, -5.1, 5.2, 9.1, 13.2, 17.1}, 0.0);
  Map(many);
  EXPECT_GT(Blocks(Scan(many)), 5.0);
}

TEST_F(DirectionProfileTest, ManyBlocksOverruleThePrediction) {
  const World world = WithBoards({-17.2, -13.1, -9.2, -5.1, 5.2, 9.1, 13.2, 17.1}, 0.0);
  Map(world);
  const auto posterior = Posterior(Scan(world), 0.0, 0.06, 0.03);
  EXPECT_LT(std::abs(posterior.mean_m), 0.02);
  EXPECT_LT(posterior.sigma_m, 0.03);
}

// Narrower than its places are apart it is neither drawn to one of them nor known without error.
TEST_F(DirectionProfileTest, APosteriorOfVeryManyBlocksIsNoCoarserThanTheyAre) {
  std::vector<double> at_x;
  for (int i = -40; i < 40; ++i) at_x.push_back(0.5 * i + 0.21);
  const World world = WithBoards(at_x, 0.0);
  Map(world);
  const std::vector<PointCluster> scan = Scan(world);
  const double here_m = Posterior(scan, 0.0, 0.0, 0.04).mean_m;
  for (const double off_m : {0.002, 0.004, 0.006}) {
    const auto posterior = Posterior(scan, -off_m, 0.0, 0.04);
    EXPECT_NEAR(posterior.mean_m - here_m, off_m, 0.0015) << off_m;
    EXPECT_GE(posterior.sigma_m, 5e-4) << off_m;
    EXPECT_LT(posterior.sigma_m, 0.01) << off_m;
  }
}

TEST_F(DirectionProfileTest, OneThingThatMovesDoesNot) {
  // The board has gone on by 15 cm, and the match with it.
  Map(WithBoards({5.2}, 0.0));
  const auto scan = Scan(WithBoards({5.2}, 0.15));
  const auto posterior = Posterior(scan, -0.15, 0.15, 0.03);
  EXPECT_NEAR(-0.15 + posterior.mean_m, 0.0, 0.05);
}

TEST_F(DirectionProfileTest, WhereNothingFacesItThePredictionIsAllThatIsKnown) {
  Map(World::Corridor());
  const auto posterior = Posterior(Scan(World::Corridor()), 0.0, 0.04, 0.05);
  EXPECT_NEAR(posterior.mean_m, 0.04, 0.01);
  EXPECT_NEAR(posterior.sigma_m, 0.05, 0.015);
}

TEST_F(DirectionProfileTest, EdgesOfPlanesTellWhereNoneFacesIt) {
  const World world = WithSteps();
  Map(world);
  for (const double at_m : {0.0, 0.3}) {
    const auto posterior = Posterior(Scan(world), at_m, 0.0, 0.5);
    EXPECT_LT(posterior.sigma_m, 0.35) << at_m;
    EXPECT_LT(std::abs(at_m + posterior.mean_m), 2.5 * posterior.sigma_m) << at_m;
  }
}

TEST_F(DirectionProfileTest, PlanesThatStandInForTheMapsHaveAMinimumOfTheirOwn) {
  const World world = WithBoards({-17.2, -13.1, -9.2, -5.1, 5.2, 9.1, 13.2, 17.1}, 0.0);
  Map(world);
  const auto scan = Scan(world);
  constexpr double kOlderM = -0.2;
  Surface older;
  const auto profile = [&](const PlanesInstead& instead) {
    return DirectionProfile(scan, map_, SE3(), Vector6d::Unit(3), instead);
  };
  const auto moved = [&](double weight) {
    return [&, weight](VoxelMap::NodeId surface) {
      if (map_.kind(surface) != Surface::Kind::kPlane) return WeightedPlane();
      older = map_.plane(surface);
      older.mean.x() += kOlderM;
      return WeightedPlane{&older, weight};
    };
  };
  EXPECT_NEAR(profile(moved(1.0)).With(0.0, 0.3).mean_m, kOlderM, 0.03);
  // What counts less says less, and what is none nothing.
  EXPECT_LT(profile(moved(1e-3)).Blocks(), 0.5 * profile(moved(1.0)).Blocks());
  const auto none = profile([](VoxelMap::NodeId) { return WeightedPlane(); });
  EXPECT_EQ(none.Blocks(), 0.0);
  EXPECT_GT(none.With(0.0, 0.3).sigma_m, 0.25);
}

TEST_F(DirectionProfileTest, PlanesOfFewFramesEndNowhere) {
  const World world = WithSteps();
  Map(world, 2);
  EXPECT_GT(Posterior(Scan(world), 0.0, 0.0, 0.5).sigma_m, 0.4);
}

TEST_F(DirectionProfileTest, AViewOfFewWallsHasNoEdgesToSpare) {
  const World world = WithSteps();
  Map(world);
  std::vector<PointCluster> few;
  for (const PointCluster& cluster : Scan(world)) {
    const Eigen::Vector3d& p = cluster.mean;
    if (p.x() > 0.0 && p.x() < 8.0 && p.y() > 0.0 && p.z() < 0.0) few.push_back(cluster);
  }
  EXPECT_GT(Posterior(few, 0.0, 0.0, 0.5).sigma_m, 0.4);
}

}  // namespace
}  // namespace lamina
