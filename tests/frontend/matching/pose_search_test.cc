#include "frontend/matching/pose_search.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/base/angle.h"
#include "tests/support/scenes/random_rooms.h"

namespace lamina {
namespace {

SE3 Turned(const SE3& T, double degrees) {
  return SE3(T.q * ExpSO3(Radians(degrees) * Eigen::Vector3d::UnitZ()), T.t);
}

// A scan in the map of a room, matched where it was taken.
struct MatchedScan {
  MatchedScan(const World& room, const SE3& T_world_lidar) : truth(T_world_lidar) {
    Draws draws(3);
    FillMap(room, 5, 1500, 0.01, &draws, &map);
    clusters = Untimed(ScanFrom(truth, room.Sample(1500, 0.01, &draws), map.options().LeafSize()));
    prediction.T_world_lidar = truth;
    prediction.covariance.setIdentity();
    match = matcher.Match(clusters, prediction, map);
  }
  bool Unique(const std::vector<SE3>& dense) const {
    PoseHypotheses hypotheses;
    hypotheses.dense = dense;
    return search.Unique({clusters, prediction, map, false}, hypotheses, match);
  }
  bool Distinct() const {
    return search.Elsewhere({clusters, prediction, map, true}, PoseHypotheses(), match).isZero();
  }

  SE3 truth;
  VoxelMap map{VoxelMapOptions{}};
  std::vector<PointCluster> clusters;
  ScanMatcher matcher{ScanMatcherOptions{}};
  PoseSearch search{PoseSearchOptions{}, matcher};
  PosePrediction prediction;
  MatchResult match;
};

// A descent may end anywhere; that it has no rival among the turns that were tried says nothing of
// those about where it ended.
TEST(PoseSearchTest, AMatchTurnedAwayFromAllThatWasTriedIsNotUnique) {
  const MatchedScan scan(World::Room(), SE3(Eigen::Quaterniond::Identity(), {0.3, -0.2, 0.1}));
  ASSERT_EQ(scan.match.status, MatchResult::Status::kConverged);
  for (const auto& [turned_deg, unique] :
       {std::pair{0.0, true}, {25.0, true}, {50.0, false}, {180.0, false}}) {
    EXPECT_EQ(scan.Unique(TurnsAbout(PoseSearchOptions{}, {Turned(scan.truth, turned_deg)})),
              unique)
        << turned_deg;
  }
  EXPECT_TRUE(scan.Unique({}));
  // No turns were tried about a start whose heading is not known.
  EXPECT_TRUE(scan.Unique(OffsetsAbout(PoseSearchOptions{}, Turned(scan.truth, 50.0))));
}

// Half a room fits the other half, though no hypothesis was turned so far.
TEST(PoseSearchTest, AMatchThatWasTurnedHasARivalWhereTheRoomComesUponItself) {
  World box = World::Corner();
  box.facets.push_back({{-5.1, 0, 0}, {0, 5, 0}, {0, 0, 1.5}});
  box.facets.push_back({{0, -4.3, 0}, {5, 0, 0}, {0, 0, 1.5}});
  World furnished = box;
  furnished.facets.push_back({{2.6, 1.2, 0}, {0, 2.0, 0}, {0, 0, 1.5}});
  furnished.facets.push_back({{-1.4, -2.6, 0}, {1.8, 0, 0}, {0, 0, 1.5}});
  for (const auto& [room, unique] : {std::pair{furnished, true}, {box, false}}) {
    MatchedScan scan(room, SE3(ExpSO3(0.6 * Eigen::Vector3d::UnitZ()), {0.9, -0.7, 0.1}));
    scan.prediction.T_world_lidar = Turned(scan.truth, 60.0);
    EXPECT_EQ(scan.Unique(TurnsAbout(PoseSearchOptions{}, {scan.truth})), unique);
  }
}

// A room whose walls are a square tells no quarter turn, unless the motion before it does.
TEST(PoseSearchTest, AMatchIsDistinctFromOtherHeadingsByWhatIsSeenOrByTheMotion) {
  const World square = World::Square(), room = World::Room();
  struct Case {
    const World& room;
    double turn_sigma_deg;
    bool distinct;
  };
  for (const Case& c :
       {Case{square, 60.0, false}, Case{square, 5.0, true}, Case{room, 60.0, true}}) {
    MatchedScan scan(c.room, SE3(Eigen::Quaterniond::Identity(), {0.2, -0.1, 0.1}));
    ASSERT_EQ(scan.match.status, MatchResult::Status::kConverged);
    scan.prediction.covariance.diagonal().head<3>().setConstant(
        std::pow(Radians(c.turn_sigma_deg), 2));
    EXPECT_EQ(scan.Distinct(), c.distinct) << c.turn_sigma_deg;
  }
}

}  // namespace
}  // namespace lamina
