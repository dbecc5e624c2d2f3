#include "backend/opening/beam_angles.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <string>
#include <utility>
#include <vector>

#include "core/base/angle.h"
#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

constexpr int kSweeps = 10, kAzimuths = 600;
constexpr double kSweepS = 0.1;

class MadeScans : public ScanSource {
 public:
  std::size_t size() const override { return scans_.size(); }
  std::string Name(std::size_t i) const override { return std::to_string(i); }
  StampNs Stamp(std::size_t i) const override { return scans_[i].stamp_ns; }
  Scan Read(std::size_t i) const override { return scans_[i]; }

 protected:
  std::vector<Scan> scans_;
};

// Drives along x on a road between two walls, 16 beams 2 degrees apart; every map of this place is
// as thin, whatever its scans are bent by.
class Street final : public MadeScans {
 public:
  explicit Street(double speed_m_s) : speed_m_s_(speed_m_s) {
    for (int k = 0; k < kSweeps; ++k) scans_.push_back(Sweep(k));
  }

  // Brings all points to where the sensor was so long after the stamp.
  Street& CompensatedTo(double moment_s) {
    for (Scan& scan : scans_) {
      for (std::size_t i = 0; i < scan.points.size(); ++i) {
        scan.points[i].x +=
            static_cast<float>(speed_m_s_ * (static_cast<double>(scan.time_s[i]) - moment_s));
      }
    }
    return *this;
  }
  // Beams at any angle.
  Street& WithoutBeams() {
    Draws draws(1);
    for (Scan& scan : scans_) {
      for (ScanPoint& p : scan.points)
        p.z += 0.05F * std::hypot(p.x, p.y) * static_cast<float>(draws.Uniform(-1.0, 1.0));
    }
    return *this;
  }
  // Adds a point to the middle of each scan.
  void Spoil(const ScanPoint& point, float time_s) {
    for (Scan& scan : scans_) {
      const auto middle = static_cast<std::ptrdiff_t>(scan.points.size() / 2);
      scan.points.insert(scan.points.begin() + middle, point);
      scan.time_s.insert(scan.time_s.begin() + middle, time_s);
    }
  }
  Trajectory Poses() const {
    Trajectory poses;
    for (const Scan& scan : scans_) {
      poses.push_back({scan.stamp_ns, SE3()});
      poses.back().T_world_lidar.t.x() = speed_m_s_ * SecondsBetween(0, scan.stamp_ns);
    }
    return poses;
  }

 private:
  static Scan Sweep(int k) {
    Scan scan;
    scan.stamp_ns = k * static_cast<StampNs>(kSweepS * 1e9);
    for (int step = 0; step < kAzimuths; ++step) {
      const double azimuth = -2.0 * M_PI * step / kAzimuths;
      for (double elevation_deg = -15.0; elevation_deg <= 15.0; elevation_deg += 2.0) {
        const double elevation = Radians(elevation_deg);
        const Eigen::Vector3d ray(std::cos(elevation) * std::cos(azimuth),
                                  std::cos(elevation) * std::sin(azimuth), std::sin(elevation));
        const double to_wall = 8.0 / std::max(1e-9, std::abs(ray.y()));
        const double range = ray.z() < 0.0 ? std::min(to_wall, -1.8 / ray.z()) : to_wall;
        if (range > 60.0) continue;
        const Eigen::Vector3f p = (range * ray).cast<float>();
        scan.points.push_back({p.x(), p.y(), p.z(), 0.0F});
        scan.time_s.push_back(static_cast<float>(kSweepS * step / kAzimuths));
      }
    }
    return scan;
  }

  double speed_m_s_;
};

TEST(BeamAngles, OfSweepsAreThoseOfTheBeams) {
  for (const double speed_m_s : {4.0, 10.0, 35.0}) {
    const Street street(speed_m_s);
    EXPECT_EQ(BeamAnglesOf(street, 0, street.Poses()), BeamAngles::kAsMeasured) << speed_m_s;
  }
}

TEST(BeamAngles, OfCompensatedScansAreNotWhateverTheMomentTheyWereBroughtTo) {
  for (const double speed_m_s : {4.0, 10.0, 35.0}) {
    for (const double moment_s : {0.0, 0.5 * kSweepS, kSweepS}) {
      const Street street = Street(speed_m_s).CompensatedTo(moment_s);
      EXPECT_EQ(BeamAnglesOf(street, 0, street.Poses()), BeamAngles::kCompensated)
          << speed_m_s << " " << moment_s;
    }
  }
}

TEST(BeamAngles, TellNothingOfASensorThatStandsOrHasNone) {
  const Street standing(0.0);
  EXPECT_EQ(BeamAnglesOf(standing, 0, standing.Poses()), BeamAngles::kUnknown);
  const Street swept = Street(10.0).WithoutBeams();
  EXPECT_EQ(BeamAnglesOf(swept, 0, swept.Poses()), BeamAngles::kUnknown);
  const Street compensated = Street(10.0).CompensatedTo(0.0).WithoutBeams();
  EXPECT_EQ(BeamAnglesOf(compensated, 0, compensated.Poses()), BeamAngles::kUnknown);
}

// Beams at whole degrees are on the border of two bins, to either of which rounding puts points,
// and on neither once the errors of poses have moved them.
TEST(BeamAngles, ErrorsOfPosesAreNoCompensation) {
  const Street standing(0.0);
  for (unsigned seed = 0; seed < 20; ++seed) {
    Draws draws(seed);
    Trajectory poses = standing.Poses();
    for (StampedPose& pose : poses)
      pose.T_world_lidar = SE3(ExpSO3(2e-4 * draws.Direction()), 0.002 * draws.Direction());
    EXPECT_NE(BeamAnglesOf(standing, 0, poses), BeamAngles::kCompensated) << seed;
  }
}

TEST(BeamAngles, PointsAndTimesThatAreNoneDoNotCount) {
  constexpr float kNone = std::numeric_limits<float>::quiet_NaN();
  constexpr float kFar = std::numeric_limits<float>::infinity();
  Street street(10.0);
  street.Spoil({kNone, 1.0F, 1.0F, 0.0F}, 0.0F);
  street.Spoil({kFar, kFar, -kFar, 0.0F}, 0.0F);
  street.Spoil({5.0F, 5.0F, 1.0F, 0.0F}, kNone);
  EXPECT_EQ(BeamAnglesOf(street, 0, street.Poses()), BeamAngles::kAsMeasured);
}

TEST(BeamAngles, AreOfTheScansThatThePosesAreOf) {
  const Street street(10.0);
  Trajectory later = street.Poses();
  later.erase(later.begin(), later.begin() + 4);
  EXPECT_EQ(BeamAnglesOf(street, 2, later), BeamAngles::kAsMeasured);
  EXPECT_EQ(BeamAnglesOf(street, 6, later), BeamAngles::kUnknown) << "of none of them";
  EXPECT_EQ(BeamAnglesOf(street, 0, {}), BeamAngles::kUnknown);
}

// Turns on the spot in a hall of uneven walls: elevations stay those of the beams, whatever points
// are moved by.
class Turntable final : public MadeScans {
 public:
  explicit Turntable(double turn_deg_s, double late_s = 0.0) : turn_rad_s_(Radians(turn_deg_s)) {
    Draws draws(1);
    for (int k = 0; k < 2 * kSweeps; ++k) {
      scans_.push_back(Sweep(kSweepS * k));
      scans_.back().stamp_ns += static_cast<StampNs>(1e9 * late_s * draws.Uniform(0.0, 1.0));
    }
  }
  // Brings all points to how the sensor stood so long after the stamp.
  Turntable& CompensatedTo(double moment_s) {
    for (Scan& scan : scans_) {
      for (std::size_t i = 0; i < scan.points.size(); ++i) {
        ScanPoint& p = scan.points[i];
        const Eigen::AngleAxisf turn(
            static_cast<float>(turn_rad_s_ * (static_cast<double>(scan.time_s[i]) - moment_s)),
            Eigen::Vector3f::UnitZ());
        const Eigen::Vector3f moved = turn * Eigen::Vector3f(p.x, p.y, p.z);
        p = {moved.x(), moved.y(), moved.z(), 0.0F};
      }
    }
    return *this;
  }
  Turntable& InUnitsOf(float s) {
    for (Scan& scan : scans_) {
      for (float& t : scan.time_s) t /= s;
    }
    return *this;
  }
  Trajectory Poses() const {
    Trajectory poses;
    for (std::size_t k = 0; k < scans_.size(); ++k) {
      poses.push_back({scans_[k].stamp_ns, SE3()});
      poses.back().T_world_lidar.q = Eigen::AngleAxisd(
          turn_rad_s_ * kSweepS * static_cast<double>(k), Eigen::Vector3d::UnitZ());
    }
    return poses;
  }

 private:
  Scan Sweep(double begin_s) const {
    Scan scan;
    scan.stamp_ns = static_cast<StampNs>(1e9 * begin_s);
    for (int step = 0; step < kAzimuths; ++step) {
      const double time_s = kSweepS * step / kAzimuths;
      const double azimuth = -2.0 * M_PI * step / kAzimuths;
      const double heading = azimuth + turn_rad_s_ * (begin_s + time_s);
      const double range = 12.0 + 3.0 * std::sin(5.0 * heading);
      for (double elevation_deg = -15.0; elevation_deg <= 15.0; elevation_deg += 2.0) {
        const double elevation = Radians(elevation_deg);
        scan.points.push_back({static_cast<float>(range * std::cos(azimuth)),
                               static_cast<float>(range * std::sin(azimuth)),
                               static_cast<float>(range * std::tan(elevation)), 0.0F});
        scan.time_s.push_back(static_cast<float>(time_s));
      }
    }
    return scan;
  }

  double turn_rad_s_;
};

TEST(BeamAngles, OfOneThatTurnsOnTheSpotAreToldByAzimuths) {
  for (const double turn_deg_s : {-75.0, 20.0, 75.0, 150.0}) {
    const Turntable swept(turn_deg_s);
    EXPECT_EQ(BeamAnglesOf(swept, 0, swept.Poses()), BeamAngles::kAsMeasuredAtTheirTimes)
        << turn_deg_s;
    for (const double moment_s : {0.0, 0.5 * kSweepS, kSweepS}) {
      const Turntable compensated = Turntable(turn_deg_s).CompensatedTo(moment_s);
      EXPECT_EQ(BeamAnglesOf(compensated, 0, compensated.Poses()), BeamAngles::kCompensated)
          << turn_deg_s << " " << moment_s;
    }
  }
}

TEST(BeamAngles, TellNothingByTurnsThatTimesDoNotShow) {
  const Turntable slow(2.0);
  EXPECT_EQ(BeamAnglesOf(slow, 0, slow.Poses()), BeamAngles::kUnknown);
  const Turntable in_another_unit = Turntable(75.0).InUnitsOf(0.4F);
  EXPECT_EQ(BeamAnglesOf(in_another_unit, 0, in_another_unit.Poses()), BeamAngles::kUnknown);
  // Turned by 2 deg a sweep, while stamps leave its own turn open by as much.
  const Turntable late(20.0, 0.02);
  EXPECT_EQ(BeamAnglesOf(late, 0, late.Poses()), BeamAngles::kUnknown);
}

}  // namespace
}  // namespace lamina
