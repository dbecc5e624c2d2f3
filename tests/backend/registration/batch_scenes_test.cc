// Batches of worlds that draw poses off: thin walls, bent chains, traffic.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/backend/registration/batches.h"

namespace lamina {
namespace {

using testing::HasSubstr;
using BatchStatus = RegistrationResult::Status;

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

}  // namespace
}  // namespace lamina
