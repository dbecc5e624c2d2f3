#include "backend/calibration/beam_calibration.h"

#include <gtest/gtest.h>

#include <cmath>

#include "backend/calibration/beam_system.h"
#include "core/base/angle.h"
#include "tests/support/scenes/room_walk.h"

namespace lamina {
namespace {

VoxelMapOptions SharpMap() {
  VoxelMapOptions map;
  map.noise_floor_m = 0.005;
  return map;
}

// Beams that are off each by themselves, and all by 0.3 degrees.
std::vector<RoomBeam> DifferentBeams(int count) {
  Draws draws(7);
  std::vector<RoomBeam> beams = RoomRings(count, 0.0, 0.0);
  for (RoomBeam& beam : beams) {
    beam.elevation_off_rad = Radians(0.3) + draws.Normal(Radians(0.2));
    beam.range_m = draws.Normal(0.03);
  }
  return beams;
}

// As the driver reports them.
std::vector<double> Elevations(const std::vector<RoomBeam>& beams) {
  std::vector<double> elevations;
  for (const RoomBeam& beam : beams) {
    elevations.push_back(Radians(beam.elevation_deg) + beam.elevation_off_rad);
  }
  return elevations;
}

std::vector<BeamCalibrationSegment> BeamSegments(const std::vector<RoomBeam>& beams, int count) {
  std::vector<BeamCalibrationSegment> segments;
  for (int s = 0; s < count; ++s) {
    BeamCalibrationSegment segment;
    for (RoomWalk::Stop& stop : RoomWalk(beams).Walk(10, static_cast<unsigned>(s))) {
      BeamCalibrationFrame frame;
      frame.T_world_lidar = stop.T_world_lidar;
      frame.points = std::move(stop.points);
      segment.push_back(std::move(frame));
    }
    segments.push_back(std::move(segment));
  }
  return segments;
}

TEST(BeamCalibration, FindsWhatMakesPlanesThin) {
  const std::vector<RoomBeam> beams = DifferentBeams(16);
  std::vector<BeamCalibrationSegment> segments = BeamSegments(beams, 3);
  const BeamCalibrationResult result = CalibrateBeams(Elevations(beams), SharpMap(), &segments);
  ASSERT_EQ(result.beams.size(), beams.size());
  EXPECT_TRUE(result.Thinner());
  EXPECT_LT(result.thickness_m, 0.4 * result.thickness_before_m);
  // Of a level sensor's elevations walls say little, and floor and ceiling nothing of the height
  // between them; of ranges they do.
  for (std::size_t b = 0; b < beams.size(); ++b) {
    EXPECT_NEAR(result.beams[b].range_correction_m, -beams[b].range_m, 0.02) << b;
  }
}

TEST(BeamCalibration, ASensorThatIsKnownIsLeftAlone) {
  const std::vector<RoomBeam> beams = RoomRings(16, 0.0, 0.0);
  std::vector<BeamCalibrationSegment> segments = BeamSegments(beams, 1);
  EXPECT_FALSE(CalibrateBeams(Elevations(beams), SharpMap(), &segments).Thinner());
}

TEST(BeamCalibration, OfNoPointsNothingIsSaid) {
  std::vector<BeamCalibrationSegment> segments(1, BeamCalibrationSegment(3));
  const BeamCalibrationResult result = CalibrateBeams({-0.1, 0.0, 0.1}, SharpMap(), &segments);
  EXPECT_FALSE(result.Thinner());
  for (const BeamOffset& beam : result.beams) {
    EXPECT_EQ(beam.elevation_correction_deg, 0.0);
    EXPECT_EQ(beam.range_correction_m, 0.0);
  }
}

// A plane that all unknowns act on: what is left of them after elimination is the dense system's
// own Schur complement.
TEST(BeamSystem, EliminatesPlanesAndPosesExactly) {
  constexpr int kFrames = 3, kBeams = 2;
  Draws draws(3);
  std::vector<BeamRow> rows;
  for (int i = 0; i < 40; ++i) {
    BeamRow row;
    row.frame = i % kFrames;
    row.beam = (i / kFrames) % kBeams;
    row.residual = draws.Normal(1.0);
    row.weight = draws.Uniform(0.5, 2.0);
    row.by_pose << draws.InCube(1.0), draws.InCube(1.0);
    row.by_beam << draws.Normal(1.0), draws.Normal(1.0);
    row.by_plane << 1.0, draws.Normal(1.0), draws.Normal(1.0);
    rows.push_back(row);
  }
  BeamSystem system(kFrames, kBeams);
  system.AddPlane(rows.data(), rows.data() + rows.size());
  const ReducedBeamSystem reduced = system.Reduce();

  // The first pose stays; [pose 1, pose 2, plane, beams].
  constexpr Eigen::Index kOthers = 6 * (kFrames - 1) + 3, kAll = kOthers + 2 * kBeams;
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(kAll, kAll);
  Eigen::VectorXd g = Eigen::VectorXd::Zero(kAll);
  for (const BeamRow& row : rows) {
    Eigen::VectorXd j = Eigen::VectorXd::Zero(kAll);
    if (row.frame > 0) j.segment<6>(6 * (row.frame - 1)) = row.by_pose;
    j.segment<3>(kOthers - 3) = row.by_plane;
    j.segment<2>(kOthers + 2 * row.beam) = row.by_beam;
    H += row.weight * j * j.transpose();
    g += row.weight * row.residual * j;
  }
  for (Eigen::Index i = 0; i < kOthers - 3; ++i) {
    const double sigma = i % 6 < 3 ? Radians(0.5) : 0.1;
    H(i, i) += 1.0 / (sigma * sigma);
  }
  const Eigen::MatrixXd others = H.topLeftCorner(kOthers, kOthers).inverse();
  const Eigen::MatrixXd coupling = H.bottomLeftCorner(2 * kBeams, kOthers);
  const Eigen::MatrixXd expected_H =
      H.bottomRightCorner(2 * kBeams, 2 * kBeams) - coupling * others * coupling.transpose();
  const Eigen::VectorXd expected_g = g.tail(2 * kBeams) - coupling * others * g.head(kOthers);
  EXPECT_TRUE(reduced.H.isApprox(expected_H, 1e-6)) << reduced.H << "\n\n" << expected_H;
  EXPECT_TRUE(reduced.g.isApprox(expected_g, 1e-6)) << reduced.g << "\n\n" << expected_g;
}

}  // namespace
}  // namespace lamina
