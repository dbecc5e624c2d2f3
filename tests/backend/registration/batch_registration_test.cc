#include "backend/registration/batch_registration.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "backend/bundle/formulations/registry.h"
#include "backend/bundle/solver/held_directions.h"
#include "backend/bundle/uncertainty/pose_covariance.h"
#include "backend/registration/put_back.h"
#include "tests/support/scenes/random_bundles.h"
#include "tests/support/scenes/random_rooms.h"

namespace lamina {
namespace {

using testing::HasSubstr;
using BatchStatus = RegistrationResult::Status;
using Kind = BundleFault::Kind;

VoxelMapOptions Voxels() {
  VoxelMapOptions map;
  map.root_size_m = 0.5;
  return map;
}

SlidingWindowOptions Weights() {
  SlidingWindowOptions weights;
  weights.max_cluster_weight = 1e6;
  return weights;
}

BatchRegistration Registration(RegistrationOptions options = {},
                               const Formulation& formulation = CondensedFormulation()) {
  return BatchRegistration(options, Voxels(), Weights(), formulation);
}

struct Batch {
  std::vector<SE3> truth;
  std::vector<BatchFrame> frames;
};

BatchFrame FrameAt(const SE3& truth, const SE3& start, const Points& world, std::size_t number) {
  BatchFrame frame;
  frame.stamp_ns = static_cast<StampNs>(number) * 1000000000;
  frame.T_world_lidar = start;
  Points seen;
  for (const Eigen::Vector3d& p : world) seen.push_back(truth.Inverse() * p);
  frame.clusters = BuildScanClusters(StillPoints(seen), Voxels().LeafSize());
  frame.points = GroupByCluster(StillPoints(seen), Voxels().LeafSize());
  return frame;
}

// Poses in the middle of a world, each starting off by exactly this much; the first is exact.
Batch Batches(const World& world, int frames, double off_rad, double off_m, Draws* draws) {
  Batch batch;
  for (int k = 0; k < frames; ++k) {
    const SE3 truth = k == 0 ? SE3() : draws->Offset(0.3, 0.4);
    const SE3 off = k == 0 ? SE3() : draws->Offset(off_rad, off_m);
    batch.truth.push_back(truth);
    batch.frames.push_back(FrameAt(truth, SE3(truth.q * off.q, truth.t + off.t),
                                   world.Sample(2000, 0.005, draws), static_cast<std::size_t>(k)));
  }
  return batch;
}

double LargestBatchError(const std::vector<SE3>& a, const std::vector<SE3>& b) {
  double largest = 0.0;
  for (std::size_t k = 0; k < a.size(); ++k) {
    largest = std::max({largest, RotationAngle(a[k], b[k]), (a[k].t - b[k].t).norm()});
  }
  return largest;
}

TEST(BatchRegistration, BringsARoomTogether) {
  Draws draws(1);
  const Batch batch = Batches(World::Room(), 6, 0.01, 0.05, &draws);
  std::vector<RoundReport> rounds;
  int steps = 0;
  RegistrationCallbacks callbacks;
  callbacks.on_round = [&](const RoundReport& r) { rounds.push_back(r); };
  callbacks.on_step = [&](const RoundReport&, const BundleStep&) { ++steps; };
  const RegistrationResult result = Registration().Run(batch.frames, callbacks);
  EXPECT_EQ(result.status, BatchStatus::kConverged) << ToString(result.status);
  EXPECT_LT(LargestBatchError(result.poses, batch.truth), 0.004);
  EXPECT_TRUE(result.faults.empty());
  ASSERT_EQ(rounds.size(), result.rounds.size());
  EXPECT_GT(rounds.front().planes, 50U);
  EXPECT_LT(rounds.front().final_cost, 0.5 * rounds.front().initial_cost);
  EXPECT_GE(steps, static_cast<int>(rounds.size()));
}

TEST(BatchRegistration, CoarseVoxelsCatchPoorStarts) {
  RegistrationOptions options;
  options.rounds = 20;
  constexpr double kCoarse = 2.0;
  int fine_errors = 0, coarse_errors = 0;
  for (unsigned seed = 0; seed < 4; ++seed) {
    Draws draws(seed);
    const Batch batch = Batches(World::Room(), 5, 0.1, 0.5, &draws);
    options.coarse_root_size_m = 0.0;
    RegistrationResult result = Registration(options).Run(batch.frames, {});
    fine_errors += LargestBatchError(result.poses, batch.truth) > 0.02 ? 1 : 0;
    options.coarse_root_size_m = kCoarse;
    const BatchRegistration coarse = Registration(options);
    EXPECT_NEAR(coarse.RootSize(0), kCoarse, 1e-12);
    EXPECT_GT(coarse.RootSize(1), coarse.RootSize(2));
    EXPECT_EQ(coarse.MergeFactor(0), 4);
    EXPECT_EQ(coarse.MergeFactor(options.rounds - 1), 1);
    EXPECT_EQ(coarse.RootSize(options.rounds - 1), Voxels().root_size_m);
    result = coarse.Run(batch.frames, {});
    coarse_errors += LargestBatchError(result.poses, batch.truth) > 0.02 ? 1 : 0;
  }
  EXPECT_EQ(coarse_errors, 0);
  EXPECT_GT(fine_errors, 0) << "the start is too good to show anything";
}

TEST(BatchRegistration, EveryFormulationDoesIt) {
  for (const Formulation* formulation : Formulations()) {
    Draws draws(2);
    const Batch batch = Batches(World::Room(), 4, 0.01, 0.03, &draws);
    RegistrationOptions options;
    options.rounds = 3;
    options.solver.max_iterations = 500;
    const RegistrationResult result = Registration(options, *formulation).Run(batch.frames, {});
    EXPECT_TRUE(result.status == BatchStatus::kConverged ||
                result.status == BatchStatus::kRoundLimit)
        << formulation->name << " " << ToString(result.status);
    EXPECT_LT(LargestBatchError(result.poses, batch.truth), 0.02) << formulation->name;
  }
}

TEST(BatchRegistration, OneFrameAloneIsRefused) {
  Draws draws(3);
  const Batch batch = Batches(World::Room(), 1, 0.0, 0.0, &draws);
  const RegistrationResult result = Registration().Run(batch.frames, {});
  EXPECT_EQ(result.status, BatchStatus::kIllPosed);
  EXPECT_THAT(result.reason, HasSubstr("planes are seen by two frames or more"));
  EXPECT_EQ(LargestBatchError(result.poses, batch.truth), 0.0);
}

TEST(BatchRegistration, FramesWithoutOverlapAreNamedAndTheRestIsSolved) {
  Draws draws(4);
  Batch batch = Batches(World::Room(), 5, 0.01, 0.03, &draws);
  // Two more of another room, far away; they hold together, but not with the others.
  World far = World::Room();
  for (Facet& facet : far.facets) facet.centre += Eigen::Vector3d(200.0, 0.0, 0.0);
  for (std::size_t k = 5; k < 7; ++k) {
    const SE3 at = SE3(Eigen::Quaterniond::Identity(), Eigen::Vector3d(200.0, 0.1, 0.0)) *
                   draws.Offset(0.1, 0.2);
    batch.truth.push_back(at);
    batch.frames.push_back(FrameAt(at, at, far.Sample(2000, 0.005, &draws), k));
  }
  // And one whose scan is empty.
  batch.truth.push_back(SE3());
  batch.frames.push_back(batch.frames[0]);
  batch.frames.back().clusters.clear();
  const RegistrationResult result = Registration().Run(batch.frames, {});
  EXPECT_EQ(result.status, BatchStatus::kPartial) << result.reason;
  EXPECT_LT(LargestBatchError(result.poses, batch.truth), 0.005);
  ASSERT_EQ(result.faults.size(), 2U);
  EXPECT_EQ(result.faults[0].kind, Kind::kTooFewPlanes);
  EXPECT_THAT(result.faults[0].Describe(), HasSubstr("frame 7 shares 0 planes"));
  EXPECT_EQ(result.faults[1].kind, Kind::kApart);
  EXPECT_THAT(result.faults[1].Describe(), HasSubstr("frames 5, 6 share no plane"));
}

TEST(BatchRegistration, TwoFramesOfOnePoseWithoutOverlapAreRefused) {
  Draws draws(5);
  World ahead{{{{5.1, 0, 0}, {0, 5, 0}, {0, 0, 1.5}}}},
      behind{{{{-5.1, 0, 0}, {0, 5, 0}, {0, 0, 1.5}}}};
  const std::vector<BatchFrame> frames = {
      FrameAt(SE3(), SE3(), ahead.Sample(3000, 0.005, &draws), 0),
      FrameAt(SE3(), SE3(), behind.Sample(3000, 0.005, &draws), 1)};
  const RegistrationResult result = Registration().Run(frames, {});
  EXPECT_EQ(result.status, BatchStatus::kIllPosed);
  EXPECT_FALSE(result.reason.empty());
}

TEST(BatchRegistration, ParallelPlanesHoldOpenDirectionsAndSolveTheRest) {
  Draws draws(6);
  World floor{{{{0, 0, -1.4}, {8, 0, 0}, {0, 8, 0}}}};
  Batch batch;
  for (int k = 0; k < 4; ++k) {
    const SE3 truth(Eigen::Quaterniond::Identity(), Eigen::Vector3d(0.3 * k, 0.1 * k, 0.0));
    // Off in height, which the floor tells, and sideways, which it does not.
    const SE3 start(
        truth.q, truth.t + (k == 0 ? Eigen::Vector3d::Zero() : Eigen::Vector3d(0.05, -0.04, 0.03)));
    batch.truth.push_back(truth);
    batch.frames.push_back(
        FrameAt(truth, start, floor.Sample(20000, 0.005, &draws), static_cast<std::size_t>(k)));
  }
  for (const char* name : {"condensed", "huang", "eigen_factors", "plane_landmarks"}) {
    RegistrationOptions options;
    options.solver.max_iterations = 500;
    const RegistrationResult result =
        Registration(options, FindFormulation(name)).Run(batch.frames, {});
    ASSERT_EQ(result.status, BatchStatus::kPartial) << name << result.reason;
    EXPECT_EQ(result.faults.size(), 9U) << name;
    for (std::size_t k = 1; k < 4; ++k) {
      EXPECT_LT(std::abs(result.poses[k].t.z()), 0.003) << name;
      const Eigen::Vector3d moved = result.poses[k].t - batch.frames[k].T_world_lidar.t;
      EXPECT_LT(moved.head<2>().norm(), 1e-3) << name;
    }
  }
  const RegistrationResult result = Registration().Run(batch.frames, {});
  int sideways = 0, turns = 0;
  for (const BundleFault& fault : result.faults) {
    EXPECT_EQ(fault.kind, Kind::kOpenDirection);
    sideways += fault.Describe().find("motion along") != std::string::npos ? 1 : 0;
    turns += fault.Describe().find("turn about") != std::string::npos ? 1 : 0;
  }
  EXPECT_EQ(sideways, 6);
  EXPECT_EQ(turns, 3);
  // Known where the floor faces it, unknown along it.
  EXPECT_LT(result.covariances[1](5, 5), 1.0);
  EXPECT_GT(result.covariances[1](3, 3), 1e3);
}

// Frames 0 to 2 in one room, 3 to 5 in the next, all on one floor. The second room starts off as a
// whole, the frames in it a little more.
Batch RoomsOnOneFloor(const SE3& room_off, Draws* draws) {
  Batch batch;
  for (std::size_t k = 0; k < 6; ++k) {
    const double x = k < 3 ? -3.0 : 3.0;
    World room{{{{0, 0, -1.4}, {6, 0, 0}, {0, 3, 0}}}};
    for (const double side : {-1.0, 1.0}) {
      room.facets.push_back({{x + 2.1 * side, 0.1, 0}, {0, 2, 0}, {0, 0, 1.2}});
      room.facets.push_back({{x, 2.35 * side + 0.01 * x, 0}, {1.9, 0, 0}, {0, 0, 1.2}});
    }
    SE3 truth = draws->Offset(0.3, 0.4);
    truth.t.x() += x;
    const SE3 off = k == 0 ? SE3() : draws->Offset(0.005, 0.02);
    SE3 start(truth.q * off.q, truth.t + off.t);
    if (k >= 3)
      start = SE3(room_off.q * start.q, room_off * (start.t - 3.0 * Eigen::Vector3d::UnitX()) +
                                            3.0 * Eigen::Vector3d::UnitX());
    batch.truth.push_back(truth);
    batch.frames.push_back(FrameAt(truth, start, room.Sample(4000, 0.005, draws), k));
  }
  return batch;
}

TEST(BatchRegistration, AGroupThatSlidesIsNamedAndKeepsItsPlace) {
  for (unsigned seed = 0; seed < 3; ++seed) {
    Draws draws(seed);
    const SE3 off(ExpSO3({0, 0, 0.02}), {0.06, -0.04, 0.02});
    const Batch batch = RoomsOnOneFloor(off, &draws);
    const RegistrationResult result = Registration().Run(batch.frames, {});
    EXPECT_EQ(result.status, BatchStatus::kPartial) << result.reason;
    ASSERT_EQ(result.faults.size(), 3U) << "seed " << seed;
    const auto held = static_cast<std::size_t>(result.faults[0].frame);
    for (const BundleFault& fault : result.faults) {
      EXPECT_THAT(fault.Describe(), HasSubstr("frames 3 to 5: no plane holds their common"));
      EXPECT_EQ(fault.frame, result.faults[0].frame);
    }
    // The held frame keeps its place on the floor; the others come to it, and the floor to all.
    const SE3& start = batch.frames[held].T_world_lidar;
    EXPECT_LT((result.poses[held].t - start.t).head<2>().norm(), 0.002);
    for (std::size_t k = 0; k < 6; ++k) {
      const std::size_t of = k < 3 ? 0 : held;
      const SE3 found = result.poses[of].Inverse() * result.poses[k];
      const SE3 truth = batch.truth[of].Inverse() * batch.truth[k];
      EXPECT_LT(LargestBatchError({found}, {truth}), 0.005) << "frame " << k << " seed " << seed;
      EXPECT_NEAR(result.poses[k].t.z(), batch.truth[k].t.z(), 0.004);
      const Matrix6d& covariance = result.covariances[k];
      if (k < 3) {
        EXPECT_LT(covariance.trace(), 1e-3);
        continue;
      }
      EXPECT_GT(covariance(3, 3), 1e3) << "frame " << k;
      EXPECT_GT(covariance(4, 4), 1e3) << "frame " << k;
      EXPECT_GT(covariance.diagonal().head(3).sum(), 1e3) << "frame " << k;
      EXPECT_LT(covariance(5, 5), 1e-4 * covariance(3, 3)) << "frame " << k;
    }
  }
}

// Two rooms with a wall between them that is thinner than what passes for a plane. Through a door
// both see the end of the one, which is all that says how far the rooms are apart.
Batch RoomsOnBothSidesOfAWall(double off_rad, double off_m, Draws* draws) {
  constexpr double kThickness = 0.07;
  World shared{{{{0, 0, -1.4}, {5, 0, 0}, {0, 4, 0}},
                {{0, 4.3, 0}, {5, 0, 0}, {0, 0, 1.5}},
                {{0, -3.7, 0}, {5, 0, 0}, {0, 0, 1.5}},
                {{5.1, 3.0, 0}, {0, 0.6, 0}, {0, 0, 1.5}}}};
  Batch batch;
  for (std::size_t k = 0; k < 6; ++k) {
    const double side = k % 2 == 0 ? -1.0 : 1.0;
    World room = shared;
    room.facets.push_back({{0.12 + side * 0.5 * kThickness, -0.5, 0}, {0, 3, 0}, {0, 0, 1.5}});
    room.facets.push_back({{side * 5.1, 0, 0}, {0, 2, 0}, {0, 0, 1.5}});
    SE3 truth = draws->Offset(0.3, 0.4);
    truth.t.x() += 2.5 * side;
    const SE3 off = k == 0 ? SE3() : draws->Offset(off_rad, off_m);
    batch.truth.push_back(truth);
    batch.frames.push_back(
        FrameAt(truth, SE3(truth.q * off.q, truth.t + off.t), room.Sample(3000, 0.005, draws), k));
  }
  return batch;
}

TEST(PutPartsBack, WhatNothingLinksFollowsItsNeighbourInTime) {
  std::vector<BatchFrame> frames(6);
  std::vector<SE3> poses;
  const SE3 off(ExpSO3({0, 0.2, 0}), {0, 0, 5});
  const SE3 correction(ExpSO3({0, 0, 0.1}), {0.3, -0.2, 0});
  for (std::size_t k = 0; k < frames.size(); ++k) {
    frames[k].T_world_lidar.t = {static_cast<double>(k), 0, 0};
    poses.push_back(correction * frames[k].T_world_lidar);
  }
  // 0 is alone where it began, 5 where a round has carried it; 3 and 4 hang together, carried off
  // by a round as well.
  poses[0] = frames[0].T_world_lidar;
  poses[5] = frames[5].T_world_lidar * off;
  poses[3] = off * poses[3];
  poses[4] = off * poses[4] * SE3(ExpSO3({0.01, 0, 0}), {0, 0, 0});
  const SE3 T_3_4 = poses[3].Inverse() * poses[4];
  const std::vector<SE3> before = poses;
  BundleFault alone, last, group;
  alone.frame = 0;
  last.frame = 5;
  group.kind = Kind::kApart;
  group.frame = 3;
  group.group = {3, 4};
  PutPartsBack(frames, {alone, last, group}, &poses);
  for (const std::size_t k : {3U, 5U}) {
    const SE3 expected = correction * frames[k].T_world_lidar;
    EXPECT_LT((poses[k].t - expected.t).norm(), 1e-12) << k;
    EXPECT_LT(RotationAngle(poses[k], expected), 1e-7) << k;
  }
  const SE3 after = poses[3].Inverse() * poses[4];
  EXPECT_LT((after.t - T_3_4.t).norm(), 1e-12);
  EXPECT_LT(RotationAngle(after, T_3_4), 1e-7);
  for (const std::size_t k : {0U, 1U, 2U}) EXPECT_EQ(poses[k].t, before[k].t);
}

TEST(BatchRegistration, AThinWallDoesNotDrawItsSidesTogether) {
  for (unsigned seed = 0; seed < 4; ++seed) {
    Draws draws(seed);
    const Batch batch = RoomsOnBothSidesOfAWall(0.01, 0.05, &draws);
    const RegistrationResult result = Registration().Run(batch.frames, {});
    EXPECT_TRUE(result.faults.empty());
    EXPECT_LT(LargestBatchError(result.poses, batch.truth), 0.005) << "seed " << seed;
  }
}

// A street with recesses, of which each frame sees the stretch around it. The start is bent: every
// frame is turned by a little more than the one before it, so that the far end lies metres off.
Batch BentStreet(int frames, double bend_rad, Draws* draws) {
  constexpr double kStep = 1.0, kReach = 4.0;
  Batch batch;
  SE3 start;
  for (int k = 0; k < frames; ++k) {
    const double at = kStep * k;
    World stretch{{{{at, 0, -1.4}, {kReach, 0, 0}, {0, 2.4, 0}}}};
    for (int i = k - 4; i <= k + 4; ++i) {
      for (const double side : {-1.0, 1.0}) {
        const double y = side * (2.3 + 0.4 * ((i * i + (side > 0.0 ? 1 : 0)) % 3));
        stretch.facets.push_back({{kStep * i, y, 0}, {0.5 * kStep, 0, 0}, {0, 0, 1.2}});
        stretch.facets.push_back({{kStep * (i + 0.5), side * 2.7, 0}, {0, 0.4, 0}, {0, 0, 1.2}});
      }
    }
    batch.truth.emplace_back(Eigen::Quaterniond::Identity(), Eigen::Vector3d(at, 0, 0));
    if (k > 0) start = start * SE3(ExpSO3({0, 0, bend_rad}), {kStep, 0, 0});
    batch.frames.push_back(FrameAt(batch.truth.back(), start, stretch.Sample(400, 0.005, draws),
                                   static_cast<std::size_t>(k)));
  }
  return batch;
}

// Its frames all lie well beside their neighbours; only all of them together are carried far.
TEST(BatchRegistration, ABentChainIsStraightenedAsAWhole) {
  Draws draws(12);
  const Batch batch = BentStreet(40, 0.004, &draws);
  RegistrationOptions options;
  options.rounds = 12;
  const RegistrationResult result = Registration(options).Run(batch.frames, {});
  EXPECT_EQ(result.status, BatchStatus::kConverged) << ToString(result.status);
  EXPECT_TRUE(result.faults.empty());
  // In the frame of the gauge, which is one of them.
  EXPECT_LT(LargestBatchError({result.poses[0].Inverse() * result.poses.back()},
                              {batch.truth[0].Inverse() * batch.truth.back()}),
            0.05);
}

// A lorry drives along beside the sensor's way through a bare hall: its side has far more points
// than all walls, and goes on by 4 cm from frame to frame.
TEST(BatchRegistration, GoodPosesAreNotMadeWorseByTraffic) {
  Draws draws(13);
  Batch batch;
  for (int k = 0; k < 8; ++k) {
    const SE3 truth(draws.Offset(0.2, 0.0).q, Eigen::Vector3d(0.1 * k, 0, 0));
    Points points = World::Room().Sample(1500, 0.005, &draws);
    const double on = 0.04 * k;
    const World lorry{{{{2.0 + on, 0.6, 0.2}, {0, 0.9, 0}, {0, 0, 0.9}},
                       {{1.2 + on, 1.5 + on, 0.2}, {0.9, 0, 0}, {0, 0, 0.9}},
                       {{1.1 + on, 0.6, 1.2 + on}, {0.9, 0, 0}, {0, 0.9, 0}}}};
    for (const Eigen::Vector3d& p : lorry.Sample(40000, 0.005, &draws)) points.push_back(p);
    batch.truth.push_back(truth);
    batch.frames.push_back(FrameAt(truth, truth, points, static_cast<std::size_t>(k)));
  }
  const RegistrationResult result = Registration().Run(batch.frames, {});
  EXPECT_LT(LargestBatchError(result.poses, batch.truth), 0.005) << ToString(result.status);
  EXPECT_EQ(result.status, BatchStatus::kNoBetter);
  EXPECT_GT(result.final_misfit_m, result.initial_misfit_m);
  EXPECT_THAT(result.reason, HasSubstr("worse than that of the initial poses"));
}

TEST(BatchRegistration, HasTheSameBitsAtAnyNumberOfThreads) {
  Draws draws(7);
  const Batch batch = Batches(World::Room(), 5, 0.01, 0.05, &draws);
  std::vector<SE3> first;
  for (const std::size_t threads : {1U, 2U, 4U}) {
    const ThreadLimit limit(threads);
    const RegistrationResult result = Registration().Run(batch.frames, {});
    if (first.empty()) first = result.poses;
    EXPECT_EQ(LargestBatchError(result.poses, first), 0.0) << threads << " threads";
  }
}

TEST(BatchRegistration, PosesAreHandedOverBeforeTheCovariances) {
  Draws draws(11);
  const Batch batch = Batches(World::Room(), 4, 0.01, 0.03, &draws);
  RegistrationResult handed_over;
  RegistrationCallbacks callbacks;
  int calls = 0;
  callbacks.on_poses = [&](const RegistrationResult& result) {
    handed_over = result;
    ++calls;
  };
  const RegistrationResult result = Registration().Run(batch.frames, callbacks);
  EXPECT_EQ(calls, 1);
  EXPECT_EQ(handed_over.status, BatchStatus::kConverged);
  EXPECT_EQ(LargestBatchError(handed_over.poses, result.poses), 0.0);
  EXPECT_TRUE(handed_over.covariances.empty());
  EXPECT_EQ(result.covariances.size(), 4U);
  EXPECT_EQ(result.covariance_failure, "");
  // Of a refusal, too: the initial poses.
  const Batch alone = Batches(World::Room(), 1, 0.0, 0.0, &draws);
  EXPECT_EQ(Registration().Run(alone.frames, callbacks).status, BatchStatus::kIllPosed);
  EXPECT_EQ(calls, 2);
  EXPECT_EQ(handed_over.poses.size(), 1U);
}

TEST(BatchRegistration, StopsAfterTheRoundThatRuns) {
  Draws draws(8);
  const Batch batch = Batches(World::Room(), 4, 0.02, 0.1, &draws);
  const std::atomic<bool> stop{true};
  const RegistrationResult result = Registration().Run(batch.frames, {}, &stop);
  EXPECT_EQ(result.rounds.size(), 1U);
  EXPECT_TRUE(result.status == BatchStatus::kInterrupted ||
              result.status == BatchStatus::kConverged);
}

TEST(PoseCovariances, AreThoseOfTheDenseInverse) {
  Draws draws(9);
  BundleSceneOptions options;
  options.poses = 5;
  options.sigma_m = 0.01;
  options.weight = 1e4;
  BundleScene scene = MakeBundleScene(options, &draws);
  const std::vector<Matrix6d> covariances =
      PoseCovariances(scene.problem, scene.problem.poses, 1e6);
  const auto cost = CondensedFormulation().make_cost(scene.problem);
  Eigen::VectorXd g;
  Eigen::MatrixXd H;
  LineariseDense(scene.problem, scene.problem.poses, cost.get(), &g, &H);
  const Eigen::MatrixXd inverse = Eigen::MatrixXd(H.bottomRightCorner(24, 24)).inverse();
  EXPECT_EQ(covariances[0].norm(), 0.0);
  for (int k = 1; k < 5; ++k) {
    const Matrix6d expected = inverse.block<6, 6>(6 * (k - 1), 6 * (k - 1));
    EXPECT_LT((covariances[static_cast<std::size_t>(k)] - expected).norm(), 1e-6 * expected.norm());
  }
}

TEST(HeldSpaces, SpanWhatIsHeldAndNoMore) {
  BundleProblem problem;
  problem.poses.resize(3);
  Vector6d a = Vector6d::Zero(), b = Vector6d::Zero();
  a << 1, 1, 0, 0, 0, 0;
  b << 1, 0, 0, 2, 0, 0;
  problem.holds = {{1, a}, {1, b}, {1, Vector6d(a + 3.0 * b)}};
  const std::vector<HeldSpace> held = HeldSpaces(problem);
  EXPECT_EQ(held[0].cols(), 6);
  ASSERT_EQ(held[1].cols(), 2);
  EXPECT_EQ(held[2].cols(), 0);
  EXPECT_LT((held[1].transpose() * held[1] - Eigen::Matrix2d::Identity()).norm(), 1e-12);
  for (const Vector6d& v : {a, b}) {
    EXPECT_LT((v - held[1] * (held[1].transpose() * v)).norm(), 1e-12);
  }
}

// A long chain, each plane seen by few neighbours: the sparse path must give the dense one's poses.
TEST(LevenbergMarquardt, SparseAndDenseFactorisationsAgree) {
  Draws draws(10);
  BundleScene scene;
  const int frames = 80;
  for (int k = 0; k < frames; ++k) {
    scene.truth.emplace_back(draws.Offset(0.1, 0.0).q, Eigen::Vector3d(0.5 * k, 0, 0));
    const SE3 off = k == 0 ? SE3() : draws.Offset(0.01, 0.03);
    scene.problem.poses.emplace_back(scene.truth.back().q * off.q, scene.truth.back().t + off.t);
  }
  for (int p = 0; p < 12 * frames; ++p) {
    const int at = p / 12;
    const Patch patch(Eigen::Vector3d(0.5 * at, 0, 0) + draws.InCube(3.0), draws.Direction());
    Plane plane;
    plane.first = static_cast<std::int32_t>(scene.problem.observations.size());
    for (int k = std::max(0, at - 2); k <= std::min(frames - 1, at + 2); ++k, ++plane.count) {
      const SE3 T_lidar_world = scene.truth[static_cast<std::size_t>(k)].Inverse();
      Points seen;
      for (int i = 0; i < 10; ++i) seen.push_back(T_lidar_world * patch.Point(1.0, 0.005, &draws));
      scene.problem.observations.push_back({k, ClusterOf(seen)});
    }
    scene.problem.planes.push_back(plane);
  }
  // Priors along the chain, and one across it that closes a loop.
  for (int k = 1; k < frames; ++k) {
    const auto i = static_cast<std::size_t>(k);
    scene.problem.priors.push_back(
        {k - 1, k, scene.truth[i - 1].Inverse() * scene.truth[i], 10.0 * Matrix6d::Identity()});
  }
  scene.problem.priors.push_back(
      {frames - 1, 0, scene.truth.back().Inverse() * scene.truth[0], 5.0 * Matrix6d::Identity()});
  // A frame in the middle that does not rise, whatever its priors say.
  scene.problem.holds.push_back({frames / 2, Vector6d::Unit(5)});
  ASSERT_LT(BlockPattern(scene.problem, BundleIndex(scene.problem)).Density(), 0.25);
  BundleAdjusterOptions options{100, 1e-14, 3};
  const BundleResult sparse = AdjustBundle(scene.problem, options);
  // Priors that say nothing between all frames make the solver take the dense way.
  for (int a = 0; a < frames; ++a) {
    for (int b = a + 1; b < frames; ++b)
      scene.problem.priors.push_back({a, b, SE3(), Matrix6d::Zero()});
  }
  const BundleResult dense = AdjustBundle(scene.problem, options);
  EXPECT_TRUE(sparse.usable());
  EXPECT_LT(sparse.final_cost, 0.1 * sparse.initial_cost);
  EXPECT_NEAR(sparse.final_cost, dense.final_cost, 1e-9 * dense.final_cost);
  EXPECT_LT(LargestBatchError(sparse.poses, dense.poses), 1e-6);
}

}  // namespace
}  // namespace lamina
