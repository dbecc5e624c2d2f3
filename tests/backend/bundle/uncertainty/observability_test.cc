#include "backend/bundle/uncertainty/observability.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "backend/bundle/uncertainty/pose_covariance.h"
#include "tests/support/scenes/bundle_rooms.h"

namespace lamina {
namespace {

using testing::AllOf;
using testing::Each;
using testing::ElementsAre;
using testing::Field;
using testing::HasSubstr;
using testing::IsEmpty;
using testing::SizeIs;

std::vector<std::string> Sentences(const Observability& found) {
  std::vector<std::string> sentences;
  for (const BundleFault& fault : found.faults) sentences.push_back(fault.Describe());
  return sentences;
}

// Part of a twist's metres that lies in these directions of translation and the turn about z.
double InPlane(const Vector6d& twist) {
  const double turn = 3.0 * twist(2);
  return std::sqrt(turn * turn + twist.segment<2>(3).squaredNorm()) /
         std::sqrt(9.0 * twist.head<3>().squaredNorm() + twist.tail<3>().squaredNorm());
}

TEST(Observability, ARoomIsDetermined) {
  Scene scene(1);
  scene.AddRooms(1);
  const Observability found = scene.Find();
  EXPECT_THAT(Sentences(found), IsEmpty());
  EXPECT_THAT(found.holds, SizeIs(6));
  EXPECT_THAT(found.free_frames, ElementsAre(1, 2));
}

TEST(Observability, RoomsOnOneFloorSlideAsGroups) {
  for (unsigned seed = 0; seed < 5; ++seed) {
    Scene scene(seed);
    scene.AddRooms(2);
    const Observability found = scene.Find();
    ASSERT_THAT(found.faults, SizeIs(3)) << "seed " << seed;
    for (const BundleFault& fault : found.faults) {
      EXPECT_EQ(fault.kind, BundleFault::Kind::kOpenDirection);
      EXPECT_EQ(fault.group, Frames(3, 6));
      EXPECT_THAT(fault.Describe(), HasSubstr("frames 3 to 5: no plane holds their common "));
      EXPECT_GT(InPlane(fault.direction), 0.99) << fault.Describe();
      EXPECT_EQ(fault.frame, found.faults[0].frame);
    }
    EXPECT_THAT(found.holds, SizeIs(9));
    EXPECT_THAT(found.free_frames, SizeIs(5));
  }
}

TEST(Observability, AWallInCommonLeavesOneDirection) {
  Scene scene(2);
  scene.AddRooms(2);
  scene.AddWall({4.0, 2.5, 0.0}, kY, Frames(0, 6));
  const Observability found = scene.Find();
  ASSERT_THAT(found.faults, SizeIs(1));
  EXPECT_EQ(found.faults[0].group, Frames(3, 6));
  EXPECT_GT(std::abs(found.faults[0].direction.tail<3>().normalized().x()), 0.999);
  EXPECT_THAT(found.faults[0].Describe(), HasSubstr("motion along the world's direction"));
  // The end of the corridor that both see determines that, too.
  scene.AddWall({11.0, 0.0, 0.0}, kX, {1, 2, 4});
  EXPECT_THAT(Sentences(scene.Find()), IsEmpty());
}

TEST(Observability, AGroupTiedByOnePlaneAloneSlidesOnIt) {
  Scene scene(3);
  for (int i = 0; i < 2; ++i) {
    const Eigen::Vector3d at = 8.0 * i * kX;
    const std::vector<int> frames = scene.AddFrames(4, at);
    scene.AddRoom(at, frames);
    scene.AddFloor(at, frames);
  }
  scene.AddWall({4.0, 2.5, 0.0}, kY, {3, 4}, 3);
  const Observability found = scene.Find();
  ASSERT_THAT(found.faults, SizeIs(3));
  for (const BundleFault& fault : found.faults) EXPECT_EQ(fault.group, Frames(4, 8));
  for (const BundleFault& fault : found.faults) {
    EXPECT_LT(std::abs(fault.direction.tail<3>().y()), 0.05) << fault.Describe();
  }
}

TEST(Observability, ThreeRoomsAreTwoGroupsThatSlide) {
  Scene scene(4);
  scene.AddRooms(3);
  const Observability found = scene.Find();
  ASSERT_THAT(found.faults, SizeIs(6));
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_EQ(found.faults[i].group, i < 3 ? Frames(6, 9) : Frames(3, 6));
  }
}

TEST(Observability, TheLargestGroupStands) {
  Scene scene(5);
  const std::vector<int> few = scene.AddFrames(2, -4.0 * kX), many = scene.AddFrames(4, 4.0 * kX);
  scene.AddRoom(-4.0 * kX, few);
  scene.AddRoom(4.0 * kX, many);
  scene.AddFloor(Eigen::Vector3d::Zero(), Frames(0, 6));
  const Observability found = scene.Find();
  ASSERT_THAT(found.faults, SizeIs(3));
  for (const BundleFault& fault : found.faults) EXPECT_EQ(fault.group, few);
}

// What is fixed stands, however little of it there is.
TEST(Observability, GroupsSlideAgainstFixedClustersToo) {
  Scene scene(6);
  scene.AddRooms(2);
  for (const bool with_floor : {true, false}) {
    for (Plane& plane : scene.problem.planes) {
      const PlaneObservation& o = scene.problem.observations[static_cast<std::size_t>(plane.first)];
      const SE3& T = scene.problem.poses[static_cast<std::size_t>(o.frame)];
      const bool is_floor = plane.count == 6;
      plane.fixed = o.frame < 3 && (with_floor || !is_floor) ? o.cluster.Moved(T) : PointCluster();
    }
    const Observability found = scene.Find();
    ASSERT_GE(found.faults.size(), 3U);
    for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ(found.faults[i].group, Frames(3, 6));
    EXPECT_THAT(found.holds, SizeIs(found.faults.size()));
    if (with_floor) {
      EXPECT_THAT(found.faults, SizeIs(3));
      continue;
    }
    // All that is fixed are walls: both rooms may go up and down along them.
    ASSERT_THAT(found.faults, SizeIs(4));
    EXPECT_EQ(found.faults[3].group, Frames(0, 6));
    EXPECT_GT(std::abs(found.faults[3].direction.tail<3>().normalized().z()), 0.999);
  }
}

// Four rooms on one floor, each pair with one wall in common that leaves it a direction: together
// they leave none.
TEST(Observability, GroupsMayDetermineEachOtherOnlyTogether) {
  for (const bool whole : {true, false}) {
    Scene scene(7);
    scene.AddRooms(4);
    int pair = 0;
    for (int a = 0; a < 4; ++a) {
      for (int b = a + 1; b < 4; ++b, ++pair) {
        if (pair == 5 && !whole) continue;
        const double angle = 1.1 * pair * pair;
        scene.AddWall({4.0 * (a + b), 3.0 + 0.2 * pair, 0.0}, {std::cos(angle), std::sin(angle), 0},
                      {3 * a, 3 * a + 1, 3 * a + 2, 3 * b, 3 * b + 1, 3 * b + 2});
      }
    }
    const Observability found = scene.Find();
    EXPECT_THAT(found.faults, SizeIs(whole ? 0 : 1));
    for (const BundleFault& fault : found.faults) EXPECT_THAT(fault.group, testing::Not(IsEmpty()));
  }
}

TEST(Observability, TheDriftOfALongChainIsNoGap) {
  for (const int frames : {50, 600}) {
    Scene scene(8);
    scene.points = 20;
    scene.weight = 400.0;
    scene.sigma_m = 0.02;
    AddChain(frames, false, &scene);
    const Observability found = scene.Find();
    EXPECT_THAT(Sentences(found), IsEmpty());
    if (frames > 50) continue;
    scene.problem.holds = found.holds;
    const std::vector<Matrix6d> covariances =
        PoseCovariances(scene.problem, scene.problem.poses, 1e6);
    ASSERT_THAT(covariances, SizeIs(50));
    EXPECT_GT(std::sqrt(covariances.back().diagonal().tail(3).sum()), 2.0);
  }
}

TEST(Observability, ALoopIsOneGroup) {
  Scene scene(9);
  AddChain(60, true, &scene);
  EXPECT_THAT(Sentences(scene.Find()), IsEmpty());
}

// A chain with a gap: the ends of it see the floor and a wall of one another.
TEST(Observability, AGapInAChainIsNamed) {
  Scene scene(10);
  AddChain(40, false, &scene);
  BundleProblem& problem = scene.problem;
  // Whatever faces along the chain is seen from one side of the gap alone.
  for (std::size_t p = 3; p < problem.planes.size(); p += 4) {
    Plane& plane = problem.planes[p];
    while (
        plane.count > 1 && problem.observations[static_cast<std::size_t>(plane.first)].frame < 25 &&
        problem.observations[static_cast<std::size_t>(plane.first + plane.count - 1)].frame >= 25) {
      --plane.count;
    }
  }
  const Observability found = scene.Find();
  ASSERT_THAT(Sentences(found), SizeIs(1));
  EXPECT_EQ(found.faults[0].group, Frames(25, 40));
  EXPECT_THAT(found.faults[0].Describe(), HasSubstr("frames 25 to 39: no plane holds their"));
  EXPECT_GT(std::abs(found.faults[0].direction(3)), 0.99);
}

// A tunnel leaves each frame open along it; that is named by frame, and by no group as well.
TEST(Observability, WhatEachFrameIsOpenInMakesNoGroup) {
  Scene scene(11);
  AddChain(30, false, &scene);
  std::vector<Plane> planes;
  for (std::size_t p = 0; p < scene.problem.planes.size(); ++p) {
    if (p % 4 != 3) planes.push_back(scene.problem.planes[p]);
  }
  scene.problem.planes = planes;
  const Observability found = scene.Find();
  EXPECT_THAT(found.faults, SizeIs(29));
  EXPECT_THAT(found.faults, Each(Field(&BundleFault::group, IsEmpty())));
}

// The gauge must hold the others: a frame that is open along x would leave them free along it.
TEST(Observability, AFrameWithAnOpenDirectionIsNotTheGauge) {
  Scene scene(12);
  scene.AddFrames(1, Eigen::Vector3d::Zero());
  scene.AddRoom({0, 0, 0}, scene.AddFrames(3, Eigen::Vector3d::Zero()));
  scene.AddFloor({0, 0, 0}, Frames(0, 4));
  scene.AddWall({0, 3.5, 0}, kY, Frames(0, 4));
  const Observability found = scene.Find();
  ASSERT_THAT(found.faults, SizeIs(1));
  EXPECT_EQ(found.faults[0].frame, 0);
  EXPECT_THAT(found.faults[0].group, IsEmpty());
  EXPECT_EQ(found.holds[0].frame, 1);
}

TEST(Observability, HasTheSameBitsAtAnyNumberOfThreads) {
  Scene scene(13);
  scene.AddRooms(6);
  std::vector<BundleFault> first;
  for (const std::size_t threads : {1U, 2U, 4U}) {
    const ThreadLimit limit(threads);
    const std::vector<BundleFault> faults = scene.Find().faults;
    if (first.empty()) first = faults;
    ASSERT_EQ(faults.size(), 15U);
    for (std::size_t i = 0; i < faults.size(); ++i) {
      EXPECT_EQ(faults[i].direction, first[i].direction);
      EXPECT_EQ(faults[i].sigma_m, first[i].sigma_m);
      EXPECT_EQ(faults[i].motion, first[i].motion);
    }
  }
}

}  // namespace
}  // namespace lamina
