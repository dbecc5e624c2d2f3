// What is promised of the first scans of a recording, in adverse scenes and on seeds that have gone
// wrong.
#include <gtest/gtest.h>

#include <functional>
#include <string>
#include <utility>

#include "tests/support/promises.h"
#include "tools/promises/judge.h"
#include "tools/promises/trial.h"

namespace lamina {
namespace {

TEST(AdverseStart, WithoutStampsASteadyMotionIsFoundAsWell) {
  const Verdict verdict =
      Tried("start-20000", 1, 60, "--untimed --sensor vlp16 --rings 0 --points 0");
  EXPECT_LT(verdict.worst_m, 0.1);
  EXPECT_EQ(verdict.lost, 0u);
}

TEST(AdverseStart, ASteadyMotionIsFoundWhereMatchesMislead) {
  const Verdict city = Tried("city-mid360", 1);
  EXPECT_LT(city.worst_m, 0.1);
  EXPECT_LE(city.degenerate, 10u) << city.broken;
  const Verdict bays = Tried("bays-mid360", 5);
  EXPECT_LT(bays.worst_m, 0.1);
  EXPECT_LT(bays.lost, 12u) << bays.broken;
}

TEST(AdverseStart, OnAMotorwayIsTracked) {
  for (const int seed : {2, 3}) {
    const Verdict alone = Tried("motorway", seed);
    EXPECT_LT(alone.worst_m, 0.1) << seed;
    EXPECT_GE(alone.judged, 28u) << seed << ": " << alone.broken;
  }
  for (const int seed : {3, 9}) {
    const Verdict vans = Tried("motorway-vans", seed);
    EXPECT_LT(vans.worst_m, 0.1) << seed;
    EXPECT_GE(vans.judged, 36u) << seed << ": " << vans.broken;
  }
}

// Nothing faces the way along a corridor. By chance its rings lie on one another more sharply at 15
// to 30 m/s than at any other speed, and matches of two scans know the way to millimetres.
TEST(AdverseStart, AlongACorridorTheSensorStandsRatherThanRunsAway) {
  Promise promise = Within(0.05);
  for (const auto& [sensor, seed] : {std::pair("hdl64", 1), std::pair("os1", 5)}) {
    promise.synth = {fmt::format("--scene corridor --sensor {} --sweep --frames 24", sensor)};
    const std::vector<TrialFrame> frames = MapTrial(promise, seed, {}).frames;
    const auto way_m = [&](SE3 TrialFrame::*pose) {
      return ((frames.back().*pose).t - (frames.front().*pose).t).norm();
    };
    EXPECT_LT(way_m(&TrialFrame::T_world_lidar), way_m(&TrialFrame::T_world_lidar_true)) << seed;
    EXPECT_EQ(JudgeTrial(frames, promise).judged, 1u) << seed;  // the first
  }
}

TEST(AdverseStart, AWayThatIsNotToldFromStandingIsNotTaken) {
  EXPECT_LT(Tried("start-5000", 21).worst_m, 0.2);
  const Verdict told = Tried("start-5000", 10);
  EXPECT_LT(told.worst_m, 0.2);
  EXPECT_LT(told.degenerate, 60u);  // of 120
}

TEST(AdverseStart, AWayThatIsKnownRoughlyWaitsForMoreScans) {
  EXPECT_LT(Tried("pavement-mid360", 3, 40, "--scene carpark --noise 0.02").worst_m, 0.1);
}

TEST(AdverseStart, WhatATellingStartHasMappedIsGoneOnIn) {
  const Verdict verdict = Tried("pavement-mid360", 5, 40, "--scene carpark --noise 0.02");
  EXPECT_LT(verdict.worst_m, 0.05);
  EXPECT_LE(verdict.degenerate, 16u) << verdict.broken;
  EXPECT_EQ(verdict.pieces, 1u);
}

TEST(AdverseStart, PlanesThatNewerScansHaveJoinedDoNotTieThemToTheFirst) {
  EXPECT_LT(Tried("start-5000", 27).worst_m, 0.1);
}

TEST(AdverseStart, WhatAllScansDoubtIsNotBelieved) {
  EXPECT_LT(Tried("carpark-mid360", 22, 60).worst_m, 0.2);
}

TEST(AdverseStart, AfterALossNothingIsBelievedBeforeTheStartIsTold) {
  const Verdict verdict = Tried("brake-5000", 603, 80);
  EXPECT_LT(verdict.worst_m, 0.1);
  EXPECT_GT(verdict.lost + verdict.degenerate, 0u);
}

// Edges that single rings draw again and again are planes of a sensor that leans, and hold it where
// it stood.
TEST(AdverseStart, WhatLeansIsNotHeldByTheArcsOfItsRings) {
  Promise promise;
  promise.synth = {"--sensor vlp16 --profile start --rest-s 1 --lean-deg 30 --sweep --noise 0.01"};
  promise.synth.push_back("--frames 40 --scene bays");
  for (const int seed : {1, 3}) EXPECT_LT(Tried(promise, seed).worst_m, 0.1) << seed;
}

// Of a few thousand rays that are the same in each scan, most lie on the ground and along the way,
// where they are met again wherever the sensor is.
TEST(AdverseStart, RaysThatAreRepeatedDoNotHoldASensorThatDrives) {
  for (const std::string scene : {"city", "carpark"}) {
    Promise promise;
    promise.synth = {"--points 5000 --noise 0.01 --frames 40 --scene " + scene};
    for (const int seed : {2, 4}) {
      const Verdict verdict = Tried(promise, seed);
      EXPECT_LT(verdict.worst_m, 0.1) << scene << " " << seed << ": " << verdict.broken;
    }
  }
}

// A map made at rest has the lines of the rays, and whatever is about to set off with the sensor.
TEST(AdverseStart, AMapMadeAtRestDoesNotHoldASensorThatSetsOff) {
  for (const std::string scene : {"bays", "carpark", "lorry"}) {
    Promise promise;
    promise.synth = {"--sensor vlp16 --profile start --rest-s 3 --sweep --noise 0.01"};
    promise.synth.push_back("--frames 50 --scene " + scene);
    const Verdict verdict = Tried(promise, 1);
    EXPECT_LT(verdict.worst_m, 0.1) << scene << ": " << verdict.broken;
    EXPECT_EQ(verdict.lost, 0u) << scene;
  }
}

TEST(AdverseStart, ScansMaySettleAsWellAsTheyAreKnown) {
  EXPECT_LT(Tried("brake-5000", 64).worst_m, 0.1);
}

TEST(AdverseStart, AWayThatIsAsSharpAsASteadyMotionIsKept) {
  Promise bays = Within(0.05), glass = Within(0.05);
  bays.synth = {"--scene bays --sensor os1 --seed 2"};
  glass.synth = {"--scene glass --sensor mid360 --seed 3"};
  glass.config = "handheld";
  for (Promise& promise : {std::ref(bays), std::ref(glass)}) {
    promise.synth.push_back("--profile start --sweep --noise 0.02 --frames 20");
    const Verdict verdict = Tried(promise, 1);
    EXPECT_TRUE(verdict.kept) << promise.synth[0] << ": " << verdict.broken;
    EXPECT_EQ(verdict.pieces, 1u) << promise.synth[0];
  }
}

}  // namespace
}  // namespace lamina
