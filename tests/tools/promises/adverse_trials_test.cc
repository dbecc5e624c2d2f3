// A short form of `tools/adverse`: what is promised for adverse scenes, on seeds that take little
// time, and on those that have gone wrong.
#include <gtest/gtest.h>

#include <functional>
#include <string>
#include <vector>

#include "tests/support/promises.h"
#include "tools/promises/judge.h"
#include "tools/promises/trial.h"

namespace lamina {
namespace {

struct ShortTrial {
  std::string name;
  int frames;  // those in which all happens that is promised: the rest of a row is more of the same
};

class AdverseShortForm : public ::testing::TestWithParam<ShortTrial> {};

TEST_P(AdverseShortForm, KeepsThePromise) {
  const Verdict verdict = Tried(GetParam().name, 1, GetParam().frames);
  EXPECT_TRUE(verdict.kept) << verdict.broken;
}

INSTANTIATE_TEST_SUITE_P(
    Few, AdverseShortForm,
    ::testing::Values(ShortTrial{"field", 20}, ShortTrial{"tunnel", 20},
                      ShortTrial{"tunnel-16", 10}, ShortTrial{"glass", 60},
                      ShortTrial{"room-turn-sweep", 60}, ShortTrial{"hall-spin", 60},
                      ShortTrial{"hall-spin-sweep", 60}, ShortTrial{"start-20000", 60},
                      ShortTrial{"gap-2", 75}, ShortTrial{"spray-11", 75},
                      ShortTrial{"picked-town", 40}, ShortTrial{"picked-town-untimed", 40},
                      ShortTrial{"picked-vlp16", 40}, ShortTrial{"jump", 60},
                      ShortTrial{"jump-untimed", 60}, ShortTrial{"room-mid360", 100},
                      ShortTrial{"shake-sweep", 36}, ShortTrial{"forest-spray", 50}),
    [](const auto& p) {
      std::string name = p.param.name;
      std::replace(name.begin(), name.end(), '-', '_');
      return name;
    });

// Two scans 4.5 m apart: the descent passes by the minimum that the prediction is in.
TEST(AdversePicked, TheProfileSeesTheMinimumThatTheDescentPassesBy) {
  const Verdict verdict = Tried("picked", 3);
  EXPECT_LT(verdict.worst_m, 0.1) << verdict.broken;
}

// With a third of a scan missing few planes face the way: to bundle adjustment another minimum, 14
// cm away, is as good as the one that the frontend has chosen.
TEST(AdversePackets, BundleAdjustmentLeadsNoScanAstray) {
  const Verdict verdict = Tried("packets", 101, 60);
  EXPECT_LT(verdict.worst_m, 0.1) << verdict.broken;
}

// On foot scans some metres apart are seconds apart, in which a car could have gone beyond all that
// is searched: scans that meet as much of the map as those before them are not lost for that.
TEST(AdversePicked, IsTrackedOnFoot) {
  const Verdict verdict = Tried("picked-forest", 1, 20);
  EXPECT_LT(verdict.worst_m, 0.10) << verdict.broken;
  EXPECT_LT(verdict.lost, 15u);  // of 20
}

// Of 20 thinned scans among trees the default voxels place none.
TEST(AdversePicked, KeyframesAmongTreesAreTracked) {
  const Verdict verdict = Tried("keyframes-forest", 1, 20);
  EXPECT_LT(verdict.worst_m, 0.05) << verdict.broken;
  EXPECT_LT(verdict.lost, 5u);  // of 20
}

// The second scan is not found in the first, 4 m before it. Those after it agree with one another,
// and there is no map to be found in.
TEST(AdversePicked, BeginsAnewAfterAFirstScanThatNothingIsFoundIn) {
  Promise promise = Within(0.1);
  promise.synth = {"--scene pavement --profile picked --sensor os1 --frames 12"};
  const Verdict verdict = Tried(promise, 1);
  EXPECT_LT(verdict.lost, 8u) << verdict.broken;
}

// Vans have gone along by the time of the second scan, 1 to 4 m on, and hold it where they are: a
// place that no more than they tell is degenerate. So is every scan after it, as long as none is
// told from where else the start may have been.
TEST(AdversePicked, AStartAmongMuchThatMovesIsNotCalledTracked) {
  Promise promise = Within(0.3);
  promise.synth = {
      "--scene carpark --profile picked --untimed --sweep --sensor os1_128 --noise 0.005 --frames "
      "8"};
  const Verdict verdict = Tried(promise, 231822);
  EXPECT_LT(verdict.worst_m, 0.3) << verdict.broken;
}

// Vans drive about the sensor. With these seeds two scans fit one of them better than what stands.
TEST(AdverseCarPark, IsTrackedWhereTwoScansAreMistaken) {
  for (const int seed : {2, 7}) {
    const Verdict verdict = Tried("carpark", seed);
    EXPECT_TRUE(verdict.kept) << seed << ": " << verdict.broken;
  }
}

// The vans set off when the sensor does, and return nearly as much of what faces the way.
TEST(AdverseCarPark, DoesNotGoAlongWithWhatSetsOffTogether) {
  const Verdict start = Tried("carpark-start", 1, 60);
  EXPECT_TRUE(start.kept) << start.broken;
  const Verdict swept = Tried("carpark-start-vlp16", 1, 60);
  EXPECT_LT(swept.worst_m, 0.10);
}

// A narrow view is full of vans, near and dense, that take the sensor along; all that stands is far
// off, and seen by few points.
TEST(AdverseCarPark, EachBlockHasOneVote) {
  for (const int seed : {2, 6}) {
    const Verdict verdict = Tried("carpark-avia", seed, 60);
    EXPECT_LT(verdict.worst_m, 0.1) << verdict.broken;
    EXPECT_LT(verdict.degenerate, 10u);  // of its first 13, until all of these tell
  }
}

// Vans that drive along fill it, and of what stands two scans show no second minimum: all of the
// first scans together tell. Until then some are called degenerate.
TEST(AdverseCarPark, WhatDrivesAlongIsNotTakenForWhatStands) {
  for (const auto& [seed, speed] : {std::pair{42, "3"}, {55, "3"}, {3, "12"}}) {
    const Verdict verdict = Tried("carpark-avia", seed, 30, std::string("--speed ") + speed);
    EXPECT_LT(verdict.worst_m, 0.1) << seed << ": " << verdict.broken;
    EXPECT_LT(verdict.lost + verdict.degenerate, 10u) << seed;
  }
}

// A lorry sets off beside a sensor of 16 rings, whose planes would have both stand. Starts are
// overruled, or given up as neither is told from the other: what they called tracked before that,
// up to 0.7 m off, is called degenerate then. In the fourth it draws scans aside by 0.15 m, which
// is less than two ways differ. In the last two the lorry goes on alongside, 13 to 26 m from where
// the sensor would be if it stood: rays that repeat in each scan are no evidence of that.
TEST(AdverseLorry, DoesNotHoldWhoSetsOffBesideIt) {
  for (const int seed : {1, 9, 14, 23, 36, 50}) {
    const Verdict verdict = Tried("lorry-start-vlp16", seed, 40);
    EXPECT_LT(verdict.worst_m, 0.10) << seed;
    EXPECT_EQ(verdict.lost, 0u) << seed;
    EXPECT_LE(verdict.degenerate, seed < 36 ? 22u : 30u) << seed;
  }
}

// Few surfaces face the way, and the lorry draws scans 21 to 25 to and fro by 0.2 to 0.5 m,
// sharply. No sensor moves so: such a match is not believed where it knows least, and those after
// it only once they agree with what was mapped before.
TEST(AdverseLorry, AMatchThatLeavesASteadyMotionIsDoubted) {
  Promise promise = Within(0.1);
  promise.synth = {"--scene lorry --sensor mid360 --sweep --frames 40 --noise 0.02"};
  promise.config = "handheld";
  std::size_t judged = 0;
  for (const int seed : {1, 6}) {
    const Verdict verdict = Tried(promise, seed);
    EXPECT_LT(verdict.worst_m, 0.10) << seed;
    judged += verdict.judged;
  }
  EXPECT_GE(judged, 7u);
}

// At speed the first scan lies a leaf and more aside of where it was put as of a sensor that stood,
// once it is deskewed. Left in the leaves it was added to, it is 0.27 m off.
TEST(AdverseLorry, TheFirstScanOfOneThatDrivesIsFoundWhereItLies) {
  const Verdict verdict = Tried("lorry-mid360", 203, 40);
  EXPECT_LT(verdict.worst_m, 0.05);
  EXPECT_GE(verdict.judged, 25u);
}

// Of a few rings, or a few points, what goes along looks as sharp as what stands: such a start is
// not believed, and the next one is of a sensor that moves.
TEST(AdverseCarPark, WhatGoesAlongIsNotBelievedThoughItLooksAsSharp) {
  for (const auto& [name, seed] : {std::pair{"carpark-start-vlp16", 5},
                                   {"carpark-mid360", 4},
                                   {"carpark-mid360", 5},
                                   {"carpark-mid360", 8}}) {
    const Verdict verdict = Tried(name, seed, 60);
    EXPECT_LT(verdict.worst_m, 0.20) << name << " " << seed << ": " << verdict.broken;
    EXPECT_LT(verdict.lost + verdict.degenerate, 50u) << name << " " << seed;
  }
}

// All that a room holds lies in a few blocks of 4 m. The direction that it determines least turns
// the sensor, and no row of like things can be mistaken along it. Few surfaces of a small room face
// each direction; where floor, walls and furniture end tells it, even to a sensor of few rings.
TEST(AdverseRooms, AreDeterminedThoughTheyAreSmall) {
  // A few at the start are not: its speed is unknown.
  const Verdict stairs = Tried("stairs-mid360", 2, 60);
  EXPECT_LT(stairs.degenerate, 10u) << stairs.broken;
  EXPECT_LT(stairs.worst_m, 0.05);
  const Verdict room = Tried("room-vlp16", 2, 60);
  EXPECT_TRUE(room.kept) << room.broken;
}

// For a second this sensor sees hardly more than one wall: where it was before that, it must be
// found by more than a match that fits.
TEST(AdverseRooms, AreNotMistakenForOneAnotherAfterABlindStretch) {
  const Verdict verdict = Tried("room-avia", 1);
  EXPECT_LT(verdict.worst_m, 0.15);
  EXPECT_LT(verdict.degenerate, 130u);
}

// Out of sight for 3 s in a hand, the sensor may have turned anywhere, and half a room fits the
// other half.
TEST(AdverseRooms, AreFoundAgainAfterAGapAndNotTurnedAbout) {
  for (const int seed : {23, 32}) {
    const Verdict verdict = Tried("room-gap", seed);
    EXPECT_LT(verdict.worst_m, 0.05) << seed;
    EXPECT_LT(verdict.lost, 25u) << seed;
  }
}

// Between scans that are open along the tunnel, drops of rain determine one now and then.
TEST(AdverseTunnel, OneScanAloneDoesNotTellTheWay) {
  Promise promise = Within(0.1);
  promise.synth = {"--scene tunnel --sensor os1 --profile picked --sweep --noise 0.03 --rain 0.1",
                   "--frames 56"};
  const Verdict verdict = Tried(promise, 983962);
  EXPECT_LT(verdict.worst_m, 0.1) << verdict.broken;
}

// Without stamps a jump of 54 m looks like a scan's way, and the street there much the same: the
// scan meets a third of what the ones before did, and what it meets it does not fit.
TEST(AdverseJump, IsNoticedWithoutStamps) { EXPECT_LT(Tried("jump-untimed", 22).worst_m, 0.1); }

// The second scan lies 0.75 m off in another minimum, which planes hold to 5 mm.
TEST(AdversePicked, WithoutStampsAMinimumBesideIsDoubted) {
  const Verdict verdict = Tried("picked-untimed", 5, 14);
  EXPECT_LT(verdict.worst_m, 0.1);
  EXPECT_LE(verdict.lost, 10u);
}

// The sheets that its rings sweep held it 0.45 m back, where starts were only doubted with stamps.
// In foliage the sheets that beams sweep are planes which move along with the sensor: with this
// seed they had it stand still while it walked.
TEST(AdverseForest, WalksOnBetweenPlanesOfItsOwnBeams) {
  const Verdict verdict = Tried("forest-mid360", 2, 30);
  EXPECT_LT(verdict.worst_m, 0.15);
  EXPECT_EQ(verdict.lost, 0u);
}

// Lines that lie on lines fit best: matches turned the sensor along with its pattern, a degree a
// scan, or found nothing.
TEST(AdverseForest, IsNotTurnedAlongWithThePatternOfItsBeams) {
  for (const int seed : {5, 6}) {
    const Verdict verdict = Tried("forest-mid360", seed, 30);
    EXPECT_LT(verdict.worst_m, 0.1) << seed;
    EXPECT_LT(verdict.worst_deg, 0.7) << seed;
    EXPECT_LE(verdict.lost, 8u) << seed;
  }
}

// Two scans of such a sensor share few planes that face the way, and matches settle on any speed,
// or turn a scan about. Eight of them together show which steady motion they were taken in.
// At 34 m/s each scan is bent by 3.4 m, and a second one that is deskewed alone has little in
// common with the first. Of what faces the way among vans that go along, a fifth stands.
// Scans of one place show a sensor that sets off as one that stands, or goes the other way: a speed
// that is not told from these is none.
// Among vans that go along, eight scans know the speed to a metre per second, which puts the first
// of them a third of a metre aside: five more tell it.
// Scans after a start that all of its scans have told are compared with what these have mapped:
// with the first scan alone they would have too little in common to be of one piece.
// Planes of the first scan that fourteen scans since have joined, a metre off, do not say where
// these are: the first scan is a piece of its own.
// Vans that go along hold the sensor, by 2.4 standard deviations of all scans against it: neither
// that nor a hypothesis that agrees with it is believed before more scans have told.
// Lost at 15 m/s while it brakes, found by no search, and begun anew where it sets off: of few
// points, what faces the way holds the first scans where the piece began, 0.27 m behind.
// At 15 m/s the steady motion is found to a centimetre, and sparse scans settle to 3 cm about it.
// Refused for that, it was followed by a start at a tenth of the speed, 10 m off and called
// tracked.
// From rest along a row of like bays, which decimetres see as well at half the speed; and on foot,
// which is no constant acceleration. Poses are right, and stay those of one piece.
// Scans that were lost together are found together, and each hold the others where they see them:
// in bays a track of few rings has slid by 0.2 m, and its newest scan is where the map has that
// one.
TEST(AdverseGaps, TheFirstScanFoundAgainIsWhereTheMapHasIt) {
  Promise bays, hall;
  bays.synth = {"--scene bays --sensor vlp16"};
  hall.synth = {"--scene hall --sensor mid360"};
  hall.config = "handheld";
  for (Promise& promise : {std::ref(bays), std::ref(hall)}) {
    promise.synth.push_back("--profile gaps --sweep --noise 0.015 --frames 40 --seed 91");
    const Verdict verdict = Tried(promise, 1);
    // Along bays that repeat it is the last decimetre that is not told.
    EXPECT_LT(verdict.worst_m, 0.15) << promise.synth[0] << ": " << verdict.broken;
    EXPECT_GE(verdict.judged, 28u) << promise.synth[0];
  }
}

// A gap in a corridor that repeats: the scans after it are 5 m back, and make a place there in
// which the next ones fit best.
TEST(AdverseGaps, AMapOfTheWrongPlaceDoesNotProveIt) {
  Promise promise;
  promise.synth = {"--scene glass --sensor vlp16 --rings 0 --points 0 --frames 45",
                   "--profile gaps --sweep --noise 0.015 --seed 128"};
  const Verdict verdict = Tried(promise, 1);
  EXPECT_LT(verdict.worst_m, 0.1) << verdict.broken;
  EXPECT_GT(verdict.pieces, 1u);
  EXPECT_GE(verdict.judged, 25u);
}

// After a gap among cars the motion is that of the first scans found, and holds all others to what
// it was, while surfaces have them 0.3 to 0.5 m elsewhere: 1 m off after eight scans.
TEST(AdverseGaps, AMotionThatSurfacesContradictIsDoubted) {
  Promise promise;
  promise.synth = {"--scene carpark --sensor spinning --rings 32 --points 15000 --frames 45",
                   "--profile gaps --gap-s 1.2 --sweep --noise 0.015 --seed 131"};
  const Verdict verdict = Tried(promise, 1);
  EXPECT_LT(verdict.worst_m, 0.2) << verdict.broken;
  EXPECT_GE(verdict.judged, 30u) << verdict.broken;
}

struct WeakScene {
  std::string name;
  int seed;
  double within_m;
};

class AdverseWeakDirection : public ::testing::TestWithParam<WeakScene> {};

// A handful of surfaces hold the way, and the sharpest minimum is not always the right one.
TEST_P(AdverseWeakDirection, WhatIsCalledTrackedIsRight) {
  const auto& [name, seed, within_m] = GetParam();
  EXPECT_LT(Tried(name, seed).worst_m, within_m);
}

INSTANTIATE_TEST_SUITE_P(
    Few, AdverseWeakDirection,
    ::testing::Values(WeakScene{"lorry", 3, 0.05}, WeakScene{"lorry-start", 35, 0.1},
                      WeakScene{"gap-2", 2, 0.05}, WeakScene{"packets", 3, 0.05},
                      WeakScene{"bays-2000", 1, 0.1}, WeakScene{"start-2000", 1, 0.1},
                      WeakScene{"bays-2000", 4, 0.3}, WeakScene{"brake-5000", 5, 0.15},
                      WeakScene{"packets", 2, 0.1}, WeakScene{"gap-2", 4, 0.05},
                      WeakScene{"gap-brake", 3, 0.1}),
    [](const auto& p) {
      std::string name = p.param.name + "_" + std::to_string(p.param.seed);
      std::replace(name.begin(), name.end(), '-', '_');
      return name;
    });

}  // namespace
}  // namespace lamina
