// Whether scans without times are sweeps, of which sense and cut: by the thickness of their planes.
#include "backend/opening/sweep_choice.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <string>

#include "core/base/angle.h"
#include "tests/support/scenes/swept_drive.h"

namespace lamina {
namespace {

using Rotation = ScanPreparationOptions::Rotation;

// How the scans of a drive, which spin clockwise and are cut at the rear, lie in their files.
struct Told {
  bool compensated = false;
  bool timed = false;
  bool mirrored = false;     // left is right: the sensor spins the other way
  double turned_deg = 0.0;   // the sensor's x axis, to the right
  std::size_t standing = 0;  // so many scans from the first one on are the first one again
};

class ToldDrive final : public ScanSource {
 public:
  explicit ToldDrive(const Told& told) : told_(told) {}
  std::size_t size() const override { return told_.standing + LongDrive(false).size(); }
  std::string Name(std::size_t i) const override { return std::to_string(i); }
  StampNs Stamp(std::size_t i) const override {
    return static_cast<StampNs>(i) * (LongDrive(false).Stamp(1) - LongDrive(false).Stamp(0));
  }
  Scan Read(std::size_t i) const override {
    Scan scan = LongDrive(told_.compensated).Read(i < told_.standing ? 0 : i - told_.standing);
    scan.stamp_ns = Stamp(i);
    if (!told_.timed) scan.time_s.clear();
    const auto cosine = static_cast<float>(std::cos(Radians(told_.turned_deg)));
    const auto sine = static_cast<float>(std::sin(Radians(told_.turned_deg)));
    for (ScanPoint& p : scan.points) {
      const float x = p.x, y = told_.mirrored ? -p.y : p.y;
      p.x = cosine * x - sine * y;
      p.y = sine * x + cosine * y;
    }
    return scan;
  }

 private:
  Told told_;
};

SweepChoice Choose(const Told& told, const MappingOptions& options = {}) {
  const ToldDrive drive(told);
  return ChooseSweep(drive, 0, drive.size(), options, nullptr);
}

double ApartDeg(double a_deg, double b_deg) { return std::abs(std::remainder(a_deg - b_deg, 360)); }

TEST(SweepChoice, FindsSenseAndCutOfSweeps) {
  const SweepChoice found = Choose({});
  EXPECT_TRUE(found.swept);
  EXPECT_EQ(found.rotation, Rotation::kClockwise);
  EXPECT_NEAR(ApartDeg(found.sweep_start_azimuth_deg, 180.0), 0.0, 23.0);
  EXPECT_LT(found.by_azimuth_m, 0.9 * found.as_they_are_m);
  Told mirrored;
  mirrored.mirrored = true;
  const SweepChoice other = Choose(mirrored);
  EXPECT_TRUE(other.swept);
  EXPECT_EQ(other.rotation, Rotation::kCounterclockwise);
  EXPECT_NEAR(ApartDeg(other.sweep_start_azimuth_deg, 180.0), 0.0, 23.0);
  Told turned;
  turned.turned_deg = 70.0;
  const SweepChoice cut = Choose(turned);
  EXPECT_TRUE(cut.swept);
  EXPECT_EQ(cut.rotation, Rotation::kClockwise);
  EXPECT_NEAR(ApartDeg(cut.sweep_start_azimuth_deg, 250.0), 0.0, 23.0);
}

TEST(SweepChoice, LeavesScansThatAreCompensated) {
  Told compensated;
  compensated.compensated = true;
  const SweepChoice found = Choose(compensated);
  EXPECT_FALSE(found.swept);
  EXPECT_GT(found.as_they_are_m, 0.0);
  EXPECT_LT(1.1 * found.as_they_are_m, found.by_azimuth_m);
}

TEST(SweepChoice, IsMadeWhereTheSensorMovesAtLast) {
  Told waiting;
  waiting.standing = 20;
  EXPECT_TRUE(Choose(waiting).swept);
  Told parked;
  parked.standing = 1000;
  const SweepChoice nothing = Choose(parked);
  EXPECT_FALSE(nothing.swept);
  EXPECT_EQ(nothing.as_they_are_m, 0.0);
}

TEST(SweepChoice, IsNotAskedWhereTimesOrOptionsTell) {
  Told timed;
  timed.timed = true;
  EXPECT_EQ(Choose(timed).as_they_are_m, 0.0);
  MappingOptions off;
  off.preparation.deskew = ScanPreparationOptions::Deskew::kOff;
  EXPECT_EQ(Choose({}, off).as_they_are_m, 0.0);
}

}  // namespace
}  // namespace lamina
