#include "backend/opening/opening_look.h"

#include <gtest/gtest.h>

namespace lamina {
namespace {

OpeningLook Look(double lost_share, double thick_m, std::size_t planes = 1000) {
  OpeningLook look;
  look.tracked = lost_share == 0.0;
  look.determined = true;
  look.lost_share = lost_share;
  look.way_m = 50.0;
  look.map.planes = planes;
  look.map.median_m = thick_m;
  return look;
}

TEST(OpeningLook, TimesThatBendScansMislead) {
  const OpeningLook as_they_are = Look(0.0, 0.012);
  EXPECT_TRUE(Misled(Look(0.3, 0.013), as_they_are));
  EXPECT_TRUE(Misled(Look(0.3, 0.0, 0), as_they_are)) << "no planes";
  EXPECT_TRUE(Misled(Look(0.6, 0.0115), as_they_are)) << "most are lost";
  EXPECT_TRUE(Misled(Look(0.9, 0.005), as_they_are)) << "of two or three scans any map is thin";
}

TEST(OpeningLook, AStartAtSpeedLosesScansByRightTimes) {
  const OpeningLook as_they_are = Look(0.0, 0.012);
  EXPECT_FALSE(Misled(Look(0.3, 0.0115), as_they_are));
  // Half of 20 scans and more, until the motion was known; the others as they should be.
  EXPECT_FALSE(Misled(Look(0.55, 0.0088), as_they_are));
}

TEST(OpeningLook, NothingIsSaidWhereScansAreLostEitherWayOrNeither) {
  EXPECT_FALSE(Misled(Look(0.0, 0.02), Look(0.0, 0.012)));
  EXPECT_FALSE(Misled(Look(0.3, 0.02), Look(0.3, 0.012)));
  OpeningLook standing = Look(0.0, 0.012);
  standing.way_m = standing.turn_rad = 0.0;
  EXPECT_FALSE(Misled(Look(0.3, 0.02), standing));
}

// Of scans of which each leaves a direction open, map and way are what was predicted.
TEST(OpeningLook, NothingIsSaidByMotionsThatArePredicted) {
  OpeningLook open = Look(0.0, 0.012);
  EXPECT_TRUE(Comparable(Look(0.0, 0.02), open));
  EXPECT_TRUE(Misled(Look(0.3, 0.02), open));
  open.determined = false;
  EXPECT_FALSE(Comparable(Look(0.0, 0.02), open));
  EXPECT_FALSE(Comparable(open, Look(0.0, 0.02)));
  EXPECT_FALSE(Misled(Look(0.3, 0.02), open));
}

}  // namespace
}  // namespace lamina
