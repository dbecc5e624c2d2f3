#include "backend/registration/batch_registration.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/backend/registration/batches.h"

namespace lamina {
namespace {

using testing::HasSubstr;
using BatchStatus = RegistrationResult::Status;
using Kind = BundleFault::Kind;

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

}  // namespace
}  // namespace lamina
