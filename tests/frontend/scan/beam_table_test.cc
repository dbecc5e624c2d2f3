#include "frontend/scan/beam_table.h"

#include <gtest/gtest.h>

#include <cmath>

#include "core/base/angle.h"
#include "frontend/scan/scan_preparation.h"
#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

struct Spot {
  float x, y, z;
};

Spot At(double azimuth_deg, double elevation_deg, double range_m) {
  const double a = Radians(azimuth_deg), e = Radians(elevation_deg);
  return {static_cast<float>(range_m * std::cos(e) * std::cos(a)),
          static_cast<float>(range_m * std::cos(e) * std::sin(a)),
          static_cast<float>(range_m * std::sin(e))};
}

const std::vector<BeamOffset> kBeams = {
    {-10.0, 0.3, 0.05}, {0.0, 0.0, 0.0}, {0.4, -0.2, -0.02}, {15.0, 0.1, 0.0}};

TEST(BeamTable, APointIsOfTheNearestBeamUpToHalfTheWayToItsNeighbour) {
  const BeamTable table({kBeams[2], kBeams[0], kBeams[3], kBeams[1]});
  const auto beam = [&](double elevation_deg) {
    const Spot p = At(77.0, elevation_deg, 20.0);
    return table.BeamOf(p.x, p.y, p.z);
  };
  EXPECT_EQ(beam(-10.0), 0);
  EXPECT_EQ(beam(-9.1), 0);
  EXPECT_EQ(beam(-8.9), BeamTable::kNoBeam);
  EXPECT_EQ(beam(0.18), 1);
  EXPECT_EQ(beam(0.22), 2);
  EXPECT_EQ(beam(0.58), 2);
  EXPECT_EQ(beam(0.62), BeamTable::kNoBeam);
  EXPECT_EQ(beam(15.5), 3);
  EXPECT_EQ(table.BeamOf(0.0F, 0.0F, 0.0F), BeamTable::kNoBeam);
  EXPECT_EQ(BeamTable({}).BeamOf(1.0F, 0.0F, 0.0F), BeamTable::kNoBeam);
}

TEST(BeamTable, TurnsEachPointUpAndMovesItAway) {
  const BeamTable table(kBeams);
  for (const BeamOffset& beam : kBeams) {
    for (const double azimuth_deg : {0.0, 100.0, -170.0}) {
      Spot p = At(azimuth_deg, beam.elevation_deg, 30.0);
      const Spot expected = At(azimuth_deg, beam.elevation_deg + beam.elevation_correction_deg,
                               30.0 + beam.range_correction_m);
      table.Correct(1, &p.x, &p.y, &p.z);
      EXPECT_NEAR(p.x, expected.x, 1e-4);
      EXPECT_NEAR(p.y, expected.y, 1e-4);
      EXPECT_NEAR(p.z, expected.z, 1e-4);
    }
  }
  // Above all beams.
  Spot p = At(10.0, 60.0, 30.0);
  const Spot before = p;
  table.Correct(1, &p.x, &p.y, &p.z);
  EXPECT_EQ(p.z, before.z);
}

TEST(BeamTable, PreparationCorrectsBeamsBeforeWhatAllHaveInCommon) {
  ScanPreparationOptions options;
  options.beams = kBeams;
  options.vertical_correction_deg = 1.0;
  options.range_offset_m = 0.1;
  const Spot reported = At(45.0, -10.0, 30.0), expected = At(45.0, -8.7, 30.15);
  Scan scan;
  scan.points = {{reported.x, reported.y, reported.z, 0.0F}};
  const PreparedScan prepared = PrepareScan(scan, options, 0.1);
  ASSERT_EQ(prepared.points.size(), 1U);
  EXPECT_NEAR(prepared.points[0].x, expected.x, 1e-4);
  EXPECT_NEAR(prepared.points[0].z, expected.z, 1e-4);
}

// Sines of elevations of points of 16 beams, each elevation scattered by this.
std::vector<float> Sines(double scatter_deg) {
  Draws draws(5);
  std::vector<float> sines;
  for (int i = 0; i < 16000; ++i) {
    const double elevation_deg = -15.0 + 2.0 * (i % 16) + draws.Uniform(-scatter_deg, scatter_deg);
    sines.push_back(static_cast<float>(std::sin(Radians(elevation_deg))));
  }
  return sines;
}

TEST(FindBeams, AreFoundWhereFilesCountInMillimetres) {
  const std::vector<double> beams = FindBeams(Sines(0.01));
  ASSERT_EQ(beams.size(), 16U);
  for (std::size_t b = 0; b < beams.size(); ++b) {
    EXPECT_NEAR(Degrees(beams[b]), -15.0 + 2.0 * static_cast<double>(b), 0.005);
  }
}

TEST(FindBeams, NoneAreFoundWherePointsLieOnNoCones) {
  EXPECT_TRUE(FindBeams(Sines(0.2)).empty());
  EXPECT_TRUE(FindBeams(Sines(1.0)).empty());
  EXPECT_TRUE(FindBeams({}).empty());
  // A scan of few points, each at an elevation of its own.
  Draws draws(6);
  std::vector<float> sines;
  for (int i = 0; i < 100; ++i) sines.push_back(static_cast<float>(draws.Uniform(-0.4, 0.4)));
  EXPECT_TRUE(FindBeams(sines).empty());
}

}  // namespace
}  // namespace lamina
