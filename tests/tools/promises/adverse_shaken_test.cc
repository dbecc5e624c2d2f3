// Sensors that are shaken: what stands, among much that moves, is told though no scan is where a
// steady motion would have it.
#include <gtest/gtest.h>

#include <functional>
#include <string>

#include "tests/support/promises.h"

namespace lamina {
namespace {

// On foot, by a sensor that is shaken by 1.5 deg at 5 Hz.
Verdict InAForest(const std::string& sensor) {
  Promise promise;
  promise.config = "handheld";
  promise.synth = {"--scene forest --profile shake", sensor};
  return Tried(promise, 1);
}

// A turn that was not foreseen lets the next row of cars, or the vans, fit first.
TEST(AdverseCarPark, IsTrackedWhereTheSensorShakes) {
  for (const int seed : {3, 9}) {
    const Verdict verdict = Tried("carpark-shake", seed);
    EXPECT_LT(verdict.worst_m, 0.10) << verdict.broken;
  }
}

// The match of all clusters may end in a narrow minimum that a part of them leads out of.
TEST(AdverseCarPark, IsNotLostInANarrowMinimumWhereTheSensorShakes) {
  const Verdict verdict = Tried("carpark-shake", 601, 72);
  EXPECT_LT(verdict.worst_deg, 0.5) << verdict.broken;
  EXPECT_EQ(verdict.lost, 0u) << verdict.broken;
}

// Turned by six degrees the second scan fits the first as well; the third and all after it follow
// the second, and the first is brought to them.
TEST(AdverseShake, TheFirstScanIsWhereTheOthersHaveIt) {
  Promise promise;
  promise.synth = {"--scene pavement --sensor avia --noise 0.03 --frames 40 --seed 732838",
                   "--profile shake"};
  promise.config = "livox_avia";
  const Verdict verdict = Tried(promise, 1);
  EXPECT_LT(verdict.worst_deg, 0.5) << verdict.broken;
  EXPECT_LT(verdict.worst_m, 0.05) << verdict.broken;
  EXPECT_GE(verdict.judged, 15u) << verdict.broken;
}

// Nor do single matches tell what stands from what moves along where each sweep is of a motion of
// its own: the first ones follow cars at the sensor's speed, with which all scans together differ.
TEST(AdverseCarPark, IsTrackedWhereEachSweepIsShaken) {
  for (const int seed : {53, 58}) {
    const Verdict verdict = Tried("carpark-shake-sweep", seed, 30);
    EXPECT_LT(verdict.worst_m, 0.10) << verdict.broken;
    EXPECT_GE(verdict.judged, 20u) << verdict.broken;
  }
}

// There are two minima, of which each belongs to a motion of its own within the sweep: deskewed for
// the one where cars at the sensor's speed stay, no descent finds the one of what stands.
TEST(AdverseCarPark, IsNotTrackedAmongCarsWhereAShakenSweepSeemsToStop) {
  const Verdict verdict = Tried("carpark-shake-sweep", 54, 55);
  EXPECT_LT(verdict.worst_m, 0.10) << verdict.broken;
  EXPECT_GE(verdict.judged, 50u) << verdict.broken;
}

// Periods that are no multiple of the time between scans: each is shaken in a way of its own, some
// less than what is expected of a sensor that is not, and some more than what is believed at first.
TEST(AdverseShake, OfAnyPeriodIsFollowed) {
  Promise promise;
  promise.synth = {"--scene bays --sensor os1_128 --sweep --noise 0.01 --frames 40 --seed 71",
                   "--profile shake --shake-hz 3.3 --shake-deg 2"};
  const Verdict verdict = Tried(promise, 1);
  EXPECT_LT(verdict.worst_m, 0.10) << verdict.broken;
  EXPECT_GE(verdict.judged, 38u) << verdict.broken;
}

// The fewest planes of a room face up and down to a sensor of 16 rings. What they sweep is the
// sharpest where it rises by 1.7 m from scan to scan, and no ring meets another one's sheet.
TEST(AdverseRooms, ASensorOfFewRingsIsNotRaisedOutOfThem) {
  Promise promise;
  promise.config = "handheld";
  promise.synth = {"--scene room --sensor vlp16 --sweep --noise 0.01 --frames 20 --seed 81",
                   "--profile shake --shake-hz 4.1 --shake-deg 1 --shake-m 0.03"};
  const Verdict verdict = Tried(promise, 1);
  EXPECT_LT(verdict.worst_m, 0.10) << verdict.broken;
  EXPECT_EQ(verdict.lost, 0u) << verdict.broken;
  EXPECT_GE(verdict.judged, 8u) << verdict.broken;
}

// A vehicle on its springs, a hand that walks: each sweep is bent by a velocity that changes from
// scan to scan. What is wrong of it at 20 m bends the map, and bundle adjustment with it.
TEST(AdverseShake, WhatVibratesIsMappedAsPreciselyAsWhatDoesNot) {
  Promise hall, street;
  hall.config = "handheld";
  hall.synth = {"--scene hall --sensor os1"};
  street.config = "livox_avia";
  street.synth = {"--scene street --sensor avia --speed 3"};
  for (Promise& promise : {std::ref(hall), std::ref(street)}) {
    promise.synth.push_back("--sweep --noise 0.02 --frames 26 --profile shake");
    promise.synth.push_back("--shake-hz 1.4 --shake-deg 0.6 --shake-m 0.02 --seed 231");
    const Verdict verdict = Tried(promise, 1);
    EXPECT_LT(verdict.worst_m, 0.0045) << promise.synth[0] << ": " << verdict.broken;
    EXPECT_EQ(verdict.judged, 26u) << promise.synth[0];
  }
}

// A prediction from the turn before is wrong by twice what a shaken sensor turns: of scans without
// times as well, whose descents end beside the deepest minimum, among trees some degrees away.
TEST(AdverseShake, ATurnThatIsNotForeseenIsFoundAmongTrees) {
  const Verdict verdict = InAForest(
      "--sensor scattered --rings 128 --points 19200 --noise 0.03 --frames 26 --seed 405564");
  EXPECT_LT(verdict.worst_m, 0.02) << verdict.broken;
  EXPECT_LT(verdict.worst_deg, 0.2) << verdict.broken;
  EXPECT_GE(verdict.judged, 25u) << verdict.broken;
}

// The first two of scans that are bent to either side agree with nothing if little of a forest is
// planar: what they lie on better deskewed, they do by the votes of most blocks.
TEST(AdverseShake, AStartAmongTreesIsTracked) {
  const Verdict verdict =
      InAForest("--sensor os1_128 --sweep --noise 0.005 --frames 12 --seed 357606");
  EXPECT_LT(verdict.worst_m, 0.05) << verdict.broken;
  EXPECT_EQ(verdict.judged, 12u) << verdict.broken;
}

// To a sensor of few rings two scans of a forest fit no better than chance, though they lie right:
// the first is given up soon, and a later one, some 50 scans on, is a better start.
TEST(AdverseShake, AStartThatNothingAgreesWithIsGivenUp) {
  const Verdict verdict = InAForest(
      "--sensor spinning --rings 16 --points 66604 --noise 0.01 --frames 75 --seed 906908");
  EXPECT_LT(verdict.worst_m, 0.05) << verdict.broken;
  EXPECT_GE(verdict.judged, 8u) << verdict.broken;
}

// What takes a pose back by a metre is no motion, which the next ones would follow.
TEST(AdverseShake, APoseThatIsTakenBackMovesNothing) {
  const Verdict verdict = Tried("carpark-shake", 51);
  EXPECT_LT(verdict.worst_m, 0.15);
  EXPECT_EQ(verdict.lost, 0u);
}

}  // namespace
}  // namespace lamina
