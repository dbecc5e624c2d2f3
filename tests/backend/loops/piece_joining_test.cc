#include "backend/loops/piece_joining.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "tests/support/scenes/mapped_drives.h"

namespace lamina {
namespace {

JoinedPieces Join(const std::vector<const MappedDrive*>& drives,
                  const LoopOptions& options = DriveLoopOptions()) {
  std::vector<MapPiece> pieces;
  for (const MappedDrive* drive : drives)
    pieces.push_back({&drive->loops->submaps(), drive->loops->graph()});
  return JoinPieces(pieces, options, VoxelMapOptions(), ScanMatcherOptions());
}

// Of all submaps, against the truth in the frame of the first drive.
double WorstM(const JoinedPieces& joined, const std::vector<const MappedDrive*>& drives) {
  double worst = 0.0;
  std::size_t i = 0;
  for (const MappedDrive* drive : drives) {
    for (const Submap& submap : drive->loops->submaps()) {
      const SE3 truth = drives[0]->truth[0].Inverse() *
                        drive->truth[static_cast<std::size_t>(submap.keyframes[0].id)];
      worst = std::max(worst, (joined.graph.poses[i++].t - truth.t).norm());
    }
  }
  return worst;
}

int Accepted(const JoinedPieces& joined) {
  return static_cast<int>(
      std::count_if(joined.loops.begin(), joined.loops.end(),
                    [](const Loop& loop) { return loop.status == Loop::Status::kAccepted; }));
}

TEST(PieceJoining, DrivesOfOneTownBecomeOnePieceWhateverTheDirection) {
  const Town town(1);
  const MappedDrive first = MapDrive(town, Drive({{-60, -60}, {60, -60}, {60, 60}}), 3);
  const MappedDrive there = MapDrive(town, Drive({{0, -60}, {60, -60}, {60, 0}}), 4);
  const MappedDrive back = MapDrive(town, Drive({{60, 60}, {60, -60}, {0, -60}}), 5);
  const JoinedPieces joined = Join({&first, &there, &back});
  EXPECT_EQ(joined.part, (std::vector<std::size_t>{0, 0, 0}));
  EXPECT_GE(Accepted(joined), 6);
  EXPECT_LT(WorstM(joined, {&first, &there, &back}), 1.0);
  EXPECT_EQ(joined.graph.poses[0].t, first.loops->anchors()[0].t);
}

// What is open along its street is no loop; where the other loops have it, it does not contradict
// them, either.
TEST(PieceJoining, WhatIsOpenAlongAStreetSpeaksNotAgainstAJoin) {
  const Town town(1);
  const std::vector<SE3> way = Drive({{-60, -60}, {60, -60}, {60, 60}});
  const MappedDrive first = MapDrive(town, way, 3), second = MapDrive(town, way, 4);
  LoopOptions options = DriveLoopOptions();
  options.verification.min_facing = 120.0;  // a third of these loops have more
  const JoinedPieces joined = Join({&first, &second}, options);
  EXPECT_EQ(joined.part, (std::vector<std::size_t>{0, 0}));
  EXPECT_LT(WorstM(joined, {&first, &second}), 1.6);
  const auto open = [](const Loop& loop) {
    return loop.reason == "open along a horizontal direction";
  };
  EXPECT_GE(std::count_if(joined.loops.begin(), joined.loops.end(), open), 4);
  for (const Loop& loop : joined.loops) {
    EXPECT_TRUE(loop.status != Loop::Status::kAccepted ||
                loop.match.facing >= options.verification.min_facing);
  }
}

// Submaps that overlap in part lack much of one another's structure. Neither looked there: it does
// not contradict the loops that have them beside one another.
TEST(PieceJoining, WhatADriveDidNotLookAtSpeaksNotAgainstAJoin) {
  const Town town(1);
  const MappedDrive first = MapDrive(town, Drive({{-60, -60}, {60, -60}, {60, 60}}), 3);
  const MappedDrive second = MapDrive(town, Drive({{-35, -60}, {60, -60}, {60, 30}}), 4);
  LoopOptions options = DriveLoopOptions();
  options.verification.min_structure = 0.7;  // most of these pairs have less
  const JoinedPieces joined = Join({&first, &second}, options);
  EXPECT_EQ(joined.part, (std::vector<std::size_t>{0, 0}));
  EXPECT_LT(WorstM(joined, {&first, &second}), 1.6);
  const auto lacking = [](const Loop& loop) { return loop.reason == "structure does not agree"; };
  EXPECT_GE(std::count_if(joined.loops.begin(), joined.loops.end(), lacking), 4);
}

TEST(PieceJoining, APieceOfOneSubmapFindsItsPlace) {
  const Town town(1);
  const MappedDrive all = MapDrive(town, Drive({{-60, -60}, {60, -60}, {60, 60}}), 3, 0.0);
  const MappedDrive piece = MapDrive(town, Drive({{20, -60}, {40, -60}}), 4);
  ASSERT_EQ(piece.loops->submaps().size(), 1U);
  const JoinedPieces joined = Join({&all, &piece});
  EXPECT_EQ(joined.part, (std::vector<std::size_t>{0, 0}));
  EXPECT_LT(WorstM(joined, {&all, &piece}), 0.2);
  // Whichever came first.
  EXPECT_EQ(Join({&piece, &all}).part, (std::vector<std::size_t>{0, 0}));
}

// A street full of parked cars, and the same one empty.
TEST(PieceJoining, DrivesBetweenWhichCarsWereMovedAreJoined) {
  const Town town(1), full = town.WithParkedCars(1);
  const MappedDrive first = MapDrive(town, Drive({{-60, -60}, {60, -60}}), 3);
  const MappedDrive later = MapDrive(full, Drive({{-30, -60}, {60, -60}}), 4);
  const JoinedPieces joined = Join({&first, &later});
  EXPECT_EQ(joined.part, (std::vector<std::size_t>{0, 0}));
  EXPECT_LT(WorstM(joined, {&first, &later}), 1.0);
}

// A hall of 24 by 14 m, furnished: turned by half a turn it fits nearly as well.
Town FurnishedHall(unsigned seed) {
  std::vector<Facet> facets;
  for (double x = -10.0; x < 12.0; x += 4.0) {
    for (double y = -5.0; y < 7.0; y += 4.0) facets.push_back({{x, y, 0}, {2, 0, 0}, {0, 2, 0}});
  }
  for (const double side : {-1.0, 1.0}) {
    for (double x = -10.0; x < 12.0; x += 4.0)
      facets.push_back({{x, 7 * side, 2}, {2, 0, 0}, {0, 0, 2}});
    for (double y = -5.0; y < 7.0; y += 4.0)
      facets.push_back({{12 * side, y, 2}, {0, 2, 0}, {0, 0, 2}});
  }
  Town hall(std::move(facets));
  Draws draws(seed);
  for (int i = 0; i < 8; ++i) {
    const Eigen::Vector3d at(draws.Uniform(-11, 11), draws.Uniform(5, 6.5) * (i % 2 == 0 ? 1 : -1),
                             0.0);
    hall.AddBox(at, {draws.Uniform(0.4, 1.0), 0, 0}, {0, draws.Uniform(0.3, 0.8), 0},
                draws.Uniform(0.5, 1.2));
  }
  return hall;
}

TEST(PieceJoining, AHallIsJoinedTheRightWayRound) {
  for (unsigned seed = 1; seed <= 3; ++seed) {
    SCOPED_TRACE(seed);
    const Town hall = FurnishedHall(seed);
    const MappedDrive first =
        MapDrive(hall, Drive({{-8, -3}, {8, -3}, {8, 3}, {-8, 3}, {-8, -3}}), 3);
    const MappedDrive second = MapDrive(hall, Drive({{8, 2}, {-8, 2}, {-8, -2}, {8, -2}}), 4);
    const JoinedPieces joined = Join({&first, &second});
    EXPECT_EQ(joined.part, (std::vector<std::size_t>{0, 0}));
    EXPECT_LT(WorstM(joined, {&first, &second}), 0.1);
  }
}

// Their shell fits at two poses, furniture that stands near a wall of one is not that of the other.
TEST(PieceJoining, HallsOfOneShapeAndOtherFurnitureStayApart) {
  const std::vector<SE3> round = Drive({{-8, -3}, {8, -3}, {8, 3}, {-8, 3}, {-8, -3}});
  for (unsigned seed = 1; seed <= 4; ++seed) {
    SCOPED_TRACE(seed);
    const MappedDrive first = MapDrive(FurnishedHall(seed), round, 3);
    const MappedDrive second = MapDrive(FurnishedHall(seed + 10), round, 4);
    EXPECT_EQ(Join({&first, &second}).part, (std::vector<std::size_t>{0, 1}));
  }
}

TEST(PieceJoining, DrivesOfDifferentTownsStayApart) {
  const std::vector<SE3> drive = Drive({{-60, -60}, {60, -60}, {60, 60}});
  for (unsigned seed = 1; seed <= 2; ++seed) {
    const MappedDrive one = MapDrive(Town(seed), drive, 3);
    const MappedDrive other = MapDrive(Town(seed + 10), drive, 4);
    const JoinedPieces joined = Join({&one, &other});
    EXPECT_EQ(joined.part, (std::vector<std::size_t>{0, 1}));
    EXPECT_EQ(Accepted(joined), 0);
    // Each is as it was.
    EXPECT_EQ(joined.graph.poses.back().t, other.loops->anchors().back().t);
  }
}

// A street of equal houses, 12 m from one to the next, on both sides.
Town Terrace(double begin, double end) {
  std::vector<Facet> facets;
  for (double x = begin; x < end; x += 6.0) {
    for (double y = -33.0; y < 36.0; y += 6.0)
      facets.push_back({{x + 3, y, 0}, {3, 0, 0}, {0, 3, 0}});
  }
  for (double x = begin; x + 12.0 <= end; x += 12.0) {
    for (const double side : {-1.0, 1.0}) {
      facets.push_back({{x + 4, 8 * side, 3}, {4, 0, 0}, {0, 0, 3}});
      facets.push_back({{x + 0, 10 * side, 3}, {0, 2, 0}, {0, 0, 3}});
      facets.push_back({{x + 8, 10 * side, 3}, {0, 2, 0}, {0, 0, 3}});
      facets.push_back({{x + 10, 12 * side, 3}, {2, 0, 0}, {0, 0, 3}});
    }
  }
  return Town(std::move(facets));
}

TEST(PieceJoining, WhereHousesRepeatNothingIsJoinedWrongly) {
  const Town town = Terrace(-300, 300);
  const MappedDrive one = MapDrive(town, Drive({{-120, 0}, {0, 0}}), 3);
  const MappedDrive other = MapDrive(town, Drive({{30, 0}, {150, 0}}), 4);
  const MappedDrive piece = MapDrive(town, Drive({{-61, 0}, {-41, 0}}), 5);
  const JoinedPieces joined = Join({&one, &other, &piece});
  EXPECT_EQ(joined.part, (std::vector<std::size_t>{0, 1, 2}));
  // Registration alone would have believed many of them.
  EXPECT_GT(std::count_if(joined.loops.begin(), joined.loops.end(),
                          [](const Loop& loop) { return loop.status == Loop::Status::kWaiting; }),
            20);
}

}  // namespace
}  // namespace lamina
