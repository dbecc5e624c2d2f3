#include "backend/loops/loop_closure.h"

#include <gtest/gtest.h>

#include <map>
#include <memory>
#include <vector>

#include "backend/loops/piece_loops.h"
#include "tests/support/scenes/submap_town.h"

namespace lamina {
namespace {

constexpr double kTownLeafM = 0.8;

LoopOptions TownLoopOptions() {
  LoopOptions options;
  options.enabled = true;
  options.min_way_m = 40.0;
  return options;
}

struct TownLaps {
  std::vector<SE3> truth, odometry;  // of the keyframes
  std::unique_ptr<LoopClosure> loops;

  // Root mean square of the keyframes' errors.
  double Error(bool corrected) const {
    const AnchorCorrection correction(loops->submaps(), loops->anchors(), loops->trimmed());
    double square = 0.0;
    for (std::size_t i = 0; i < truth.size(); ++i) {
      const SE3 T = corrected
                        ? correction.Corrected(100000000 * static_cast<StampNs>(i), odometry[i])
                        : odometry[i];
      square += (T.t - truth[i].t).squaredNorm();
    }
    return std::sqrt(square / static_cast<double>(truth.size()));
  }
};

// A drive whose odometry turns and stretches a little at every step.
TownLaps MapTown(const Town& town, const std::vector<SE3>& drive, double turn_rad, double stretch,
                 const LoopOptions& options = TownLoopOptions()) {
  TownLaps mapped;
  mapped.truth = drive;
  Draws draws(11);
  SubmapBuilder builder(options.submap, kTownLeafM);
  VoxelMapOptions map;
  mapped.loops = std::make_unique<LoopClosure>(options, map, ScanMatcherOptions());
  SE3 T = drive[0];
  for (std::size_t i = 0; i < drive.size(); ++i) {
    if (i > 0) {
      SE3 step = drive[i - 1].Inverse() * drive[i];
      step.t *= 1.0 + stretch;
      T = T * step * SE3(ExpSO3({0, 0, turn_rad}), {0, 0, 0});
    }
    mapped.odometry.push_back(T);
    if (auto submap = builder.Add(
            KeyframeOf(town, static_cast<std::int64_t>(i), drive[i], T, kTownLeafM, &draws)))
      mapped.loops->Add(std::move(*submap));
  }
  mapped.loops->Add(*builder.Finish());
  return mapped;
}

const std::vector<SE3>& RoundTheBlock() {
  static const std::vector<SE3> drive =
      Drive({{0, 0}, {60, 0}, {60, 60}, {0, 60}, {0, 0}, {60, 0}, {60, 30}});
  return drive;
}

TEST(LoopClosure, TheSecondLapTakesBackTheDrift) {
  const Town town(1);
  const TownLaps mapped = MapTown(town, RoundTheBlock(), 0.0008, 0.008);
  int accepted = 0;
  for (const Loop& loop : mapped.loops->loops()) {
    if (loop.status != Loop::Status::kAccepted) continue;
    ++accepted;
    const SE3 between =
        mapped.truth[static_cast<std::size_t>(mapped.loops->submaps()[loop.from].keyframes[0].id)]
            .Inverse() *
        mapped.truth[static_cast<std::size_t>(mapped.loops->submaps()[loop.to].keyframes[0].id)];
    EXPECT_LT((loop.match.T_other_query.t - between.t).norm(), 0.3);
  }
  EXPECT_GE(accepted, 2);
  EXPECT_GT(mapped.Error(false), 1.0);
  EXPECT_LT(mapped.Error(true), 0.4 * mapped.Error(false));
  EXPECT_LT(mapped.loops->cost(), mapped.loops->cost_before());
  EXPECT_EQ(mapped.loops->graph().loops.size(), static_cast<std::size_t>(accepted));
}

// The first visit and the newest stay of each place, whatever the number of rounds.
TEST(LoopClosure, RoundsDoNotMakeTheMapGrow) {
  const Town town(1);
  LoopOptions options = TownLoopOptions();
  options.kept_visits = 1;
  std::vector<Eigen::Vector2d> corners = {{0, 0}};
  std::map<int, TownLaps> mapped;
  for (int round = 1; round <= 5; ++round) {
    corners.insert(corners.end(), {{60, 0}, {60, 60}, {0, 60}, {0, 0}});
    if (round == 3 || round == 5)
      mapped[round] = MapTown(town, Drive(corners), 0.0002, 0.002, options);
  }
  const LoopClosure &three = *mapped[3].loops, &five = *mapped[5].loops;
  const auto made = [](const LoopClosure& loops) {
    return loops.submaps().size() + loops.trimmed().size();
  };
  EXPECT_GT(made(five), made(three) + 12);
  EXPECT_LE(five.submaps().size(), three.submaps().size() + 3);
  EXPECT_LE(five.loops().size(), three.loops().size() + 15);
  EXPECT_EQ(static_cast<std::size_t>(five.submaps().back().id) + 1, made(five));
  // Poses of trimmed submaps are corrected like the others.
  EXPECT_LT(mapped[5].Error(true), 0.5);
  EXPECT_LT(mapped[5].Error(true), 0.2 * mapped[5].Error(false));
  for (const TrimmedSubmap& trimmed : five.trimmed())
    EXPECT_LT(trimmed.holder, five.submaps().size());
}

TEST(LoopClosure, WithoutARevisitNothingMoves) {
  const Town town(1);
  const TownLaps mapped = MapTown(town, Drive({{-60, -60}, {60, -60}, {60, 60}}), 0.0005, 0.005);
  for (const Loop& loop : mapped.loops->loops()) EXPECT_NE(loop.status, Loop::Status::kAccepted);
  for (std::size_t i = 0; i < mapped.loops->submaps().size(); ++i)
    EXPECT_EQ(mapped.loops->anchors()[i].t, mapped.loops->submaps()[i].T_world_submap.t);
}

TEST(LoopClosure, TheSameBitsAtAnyNumberOfThreads) {
  const Town town(1);
  const TownLaps two = MapTown(town, RoundTheBlock(), 0.0008, 0.008);
  const ThreadLimit limit(1);
  const TownLaps one = MapTown(town, RoundTheBlock(), 0.0008, 0.008);
  ASSERT_EQ(one.loops->loops().size(), two.loops->loops().size());
  for (std::size_t i = 0; i < one.loops->anchors().size(); ++i) {
    EXPECT_EQ(one.loops->anchors()[i].t, two.loops->anchors()[i].t);
    EXPECT_EQ(one.loops->anchors()[i].q.coeffs(), two.loops->anchors()[i].q.coeffs());
  }
}

TEST(AnchorCorrection, PosesMoveWithoutStepsBetweenSubmaps) {
  std::vector<Submap> submaps(2);
  submaps[0].keyframes = {{0, 100, SE3()}};
  submaps[1].keyframes = {{1, 200, SE3()}};
  const SE3 moved(Eigen::Quaterniond::Identity(), {0, 2, 0});
  const AnchorCorrection correction(submaps, {SE3(), moved});
  const SE3 T(Eigen::Quaterniond::Identity(), {50, 0, 0});
  EXPECT_EQ(correction.Corrected(0, T).t.y(), 0.0);
  EXPECT_NEAR(correction.Corrected(150, T).t.y(), 1.0, 1e-9);
  EXPECT_NEAR(correction.Corrected(175, T).t.y(), 1.5, 1e-9);
  EXPECT_NEAR(correction.Corrected(900, T).t.y(), 2.0, 1e-9);
  EXPECT_EQ(AnchorCorrection({}, {}).Corrected(0, T).t, T.t);
}

TEST(AddToMap, SubmapsLieWhereTheirAnchorsAre) {
  Draws draws(2);
  SubmapBuilder builder({}, 0.8);
  FinalKeyframe keyframe{0, 0, SE3(), {}};
  for (int i = 0; i < 5; ++i)
    keyframe.clusters.push_back(ClusterOf(Points{{0.1, 0.1 * i, 0.2}, {0.3, 0.1, 0.2 + 0.01 * i}}));
  builder.Add(keyframe);
  const std::vector<Submap> submaps = {*builder.Finish()};
  VoxelMapOptions options;
  VoxelMap map(options);
  AddToMap(submaps, {SE3(Eigen::Quaterniond::Identity(), {16.0, 0.0, 0.0})}, &map);
  EXPECT_EQ(map.FindSurface({0.2, 0.2, 0.2}), VoxelMap::kNoNode);
  const VoxelMap::NodeId node = map.FindSurface({16.2, 0.2, 0.2});
  ASSERT_NE(node, VoxelMap::kNoNode);
  EXPECT_NEAR(map.Aggregate(node).count, 10.0, 1e-5);
}

}  // namespace
}  // namespace lamina
