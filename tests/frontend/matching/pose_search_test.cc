#include "frontend/matching/pose_search.h"

#include <gtest/gtest.h>

#include "core/base/angle.h"
#include "tests/support/scenes/random_rooms.h"

namespace lamina {
namespace {

// A descent may end anywhere; that it has no rival among the turns that were tried says nothing of
// those about where it ended.
TEST(PoseSearchTest, AMatchTurnedAwayFromAllThatWasTriedIsNotUnique) {
  Draws draws(3);
  const World room = World::Room();
  VoxelMap map(VoxelMapOptions{});
  FillMap(room, 5, 1500, 0.01, &draws, &map);
  const SE3 truth(Eigen::Quaterniond::Identity(), {0.3, -0.2, 0.1});
  const std::vector<PointCluster> clusters =
      Untimed(ScanFrom(truth, room.Sample(1500, 0.01, &draws), map.options().LeafSize()));
  const ScanMatcher matcher{ScanMatcherOptions{}};
  const PoseSearch search(PoseSearchOptions{}, &matcher);
  PosePrediction prediction{truth};
  prediction.covariance.setIdentity();
  const MatchResult match = matcher.Match(clusters, prediction, map);
  ASSERT_EQ(match.status, MatchResult::Status::kConverged);
  const SearchedScan scan{clusters, prediction, map, false};
  for (const auto& [turned_deg, unique] :
       {std::pair{0.0, true}, {25.0, true}, {50.0, false}, {180.0, false}}) {
    const Eigen::Quaterniond turn = ExpSO3(Radians(turned_deg) * Eigen::Vector3d::UnitZ());
    PoseHypotheses hypotheses;
    hypotheses.dense = search.TurnsAbout({SE3(turn, truth.t)});
    EXPECT_EQ(search.Unique(scan, hypotheses, match), unique) << turned_deg;
  }
  PoseHypotheses offsets;
  EXPECT_TRUE(search.Unique(scan, offsets, match));
  const Eigen::Quaterniond unknown_heading = ExpSO3(Radians(50.0) * Eigen::Vector3d::UnitZ());
  offsets.dense = search.OffsetsAbout(SE3(unknown_heading, truth.t));
  EXPECT_TRUE(search.Unique(scan, offsets, match));
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
    Draws draws(4);
    VoxelMap map(VoxelMapOptions{});
    FillMap(room, 5, 1500, 0.01, &draws, &map);
    const SE3 truth(ExpSO3(0.6 * Eigen::Vector3d::UnitZ()), {0.9, -0.7, 0.1});
    const std::vector<PointCluster> clusters =
        Untimed(ScanFrom(truth, room.Sample(1500, 0.01, &draws), map.options().LeafSize()));
    const ScanMatcher matcher{ScanMatcherOptions{}};
    const PoseSearch search(PoseSearchOptions{}, &matcher);
    PosePrediction prediction{truth};
    prediction.covariance.setIdentity();
    const MatchResult match = matcher.Match(clusters, prediction, map);
    prediction.T_world_lidar.q = truth.q * ExpSO3(1.0 * Eigen::Vector3d::UnitZ());
    PoseHypotheses hypotheses;
    hypotheses.dense = search.TurnsAbout({truth});
    EXPECT_EQ(search.Unique({clusters, prediction, map, false}, hypotheses, match), unique);
  }
}

}  // namespace
}  // namespace lamina
