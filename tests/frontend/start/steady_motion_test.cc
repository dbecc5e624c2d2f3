#include "frontend/start/steady_motion.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "core/base/angle.h"
#include "tests/support/scenes/bay_street.h"
#include "tests/support/scenes/random_rooms.h"

namespace lamina {
namespace {

constexpr int kScans = 8;
constexpr double kScanPeriodS = 0.1, kSteadyVoxelM = 0.8;

double SteadyAt(double speed, double acceleration, int scan) {
  const double t = kScanPeriodS * (scan - 0.5 * (kScans - 1));
  return speed * t + 0.5 * acceleration * t * t;
}

// Clusters of the LiDAR frame, where they are if the sensor did not move along x.
SteadyScan SteadyScanOf(const std::vector<TimedCluster>& clusters, const SE3& T_world_lidar,
                        int scan) {
  SteadyScan made;
  made.time_s = kScanPeriodS * scan;
  const SE3 T(T_world_lidar.q, {0.0, T_world_lidar.t.y(), T_world_lidar.t.z()});
  for (const TimedCluster& cluster : clusters) made.clusters.push_back(cluster.points.Moved(T));
  return made;
}

std::vector<TimedCluster> Seen(const BayStreet& street, const SE3& T, int points, Draws* draws) {
  return BuildScanClusters(street.Scan(T, points, draws), kSteadyVoxelM);
}

std::vector<SteadyScan> InStreet(double speed, double acceleration, int points, unsigned seed) {
  const BayStreet street(seed);
  Draws draws(seed + 100);
  std::vector<SteadyScan> scans;
  for (int k = 0; k < kScans; ++k) {
    const SE3 T = BayStreet::PoseAt(100.0 + SteadyAt(speed, acceleration, k));
    scans.push_back(SteadyScanOf(Seen(street, T, points, &draws), T, k));
  }
  return scans;
}

struct FoundSpeed {
  SteadyMotion motion;
  double open_speed_m_s = 0.0;
};

FoundSpeed Find(std::vector<SteadyScan> scans) {
  const SteadyMotionSearch search(SteadyMotionOptions(), Eigen::Vector3d::UnitX(),
                                  Eigen::Vector3d::UnitZ(), std::move(scans));
  const FoundMotion found = search.Find();
  return {found.motion, search.OpenSpeed(found)};
}

TEST(SteadyMotionTest, FindsTheSpeedOfSparseScans) {
  struct Drive {
    double speed, acceleration;
  };
  for (const Drive drive : {Drive{15.0, 0.0}, Drive{-12.0, 0.0}, Drive{8.0, -3.0}, {3.0, 3.0}}) {
    for (unsigned seed = 1; seed <= 3; ++seed) {
      const FoundSpeed found = Find(InStreet(drive.speed, drive.acceleration, 3000, seed));
      EXPECT_NEAR(found.motion.speed_m_s, drive.speed, 0.8) << seed;
      for (const int scan : {0, kScans - 1}) {
        const double found_m =
            SteadyAt(found.motion.speed_m_s, found.motion.acceleration_m_s2, scan);
        EXPECT_NEAR(found_m, SteadyAt(drive.speed, drive.acceleration, scan), 0.4) << seed;
      }
      EXPECT_LE(found.open_speed_m_s, 2.0) << drive.speed << ", " << seed;
    }
  }
}

TEST(SteadyMotionTest, TheWayIsThatOfTheMotion) {
  const SteadyMotionSearch search(SteadyMotionOptions(), Eigen::Vector3d::UnitX(),
                                  Eigen::Vector3d::UnitZ(), InStreet(10.0, 0.0, 500, 1));
  const WayAlong way = search.WayUnder({10.0, 4.0});
  ASSERT_EQ(way.positions_m.size(), static_cast<std::size_t>(kScans));
  EXPECT_EQ(way.positions_m.front(), 0.0);
  EXPECT_NEAR(way.positions_m.back(), 7.0, 1e-9);  // 0.7 s at 10 m/s on the mean
  EXPECT_NEAR(way.speeds_m_s.front(), 10.0 - 4.0 * 0.35, 1e-9);
  EXPECT_NEAR(way.speeds_m_s.back(), 10.0 + 4.0 * 0.35, 1e-9);
}

TEST(SteadyMotionTest, RefutesPosesThatScatter) {
  const SteadyMotionSearch search(SteadyMotionOptions(), Eigen::Vector3d::UnitX(),
                                  Eigen::Vector3d::UnitZ(), InStreet(15.0, 0.0, 3000, 2));
  const WayAlong way = search.WayUnder({15.0, 0.0});
  WayAlong scattered = way;
  for (std::size_t k = 0; k < scattered.positions_m.size(); ++k)
    scattered.positions_m[k] += k % 2 == 0 ? 0.5 : -0.5;
  EXPECT_GT(search.Sharper(way, scattered), 3.0);
  EXPECT_LT(search.Sharper(scattered, way), -3.0);
  EXPECT_EQ(search.Sharper(way, way), 0.0);
  const FoundMotion found = search.Find();
  EXPECT_EQ(search.Sharper(found, scattered),
            search.Sharper(search.WayUnder(found.motion), scattered));
}

TEST(SteadyMotionTest, IsNotLookedForWhereTheWayRefutesAllOthers) {
  for (unsigned seed = 1; seed <= 3; ++seed) {
    const SteadyMotionSearch search(SteadyMotionOptions(), Eigen::Vector3d::UnitX(),
                                    Eigen::Vector3d::UnitZ(), InStreet(3.0, 2.0, 20000, seed));
    EXPECT_FALSE(search.FindUnlessRefutedBy(search.WayUnder({3.0, 2.0}))) << seed;
    for (const SteadyMotion wrong : {SteadyMotion{0.0, 0.0}, {15.0, 0.0}}) {
      const auto found = search.FindUnlessRefutedBy(search.WayUnder(wrong));
      ASSERT_TRUE(found) << seed;
      EXPECT_EQ(found->motion.speed_m_s, search.Find().motion.speed_m_s) << seed;
    }
  }
}

TEST(SteadyMotionTest, ALorryAtTheSensorsSpeedDoesNotStopTheStreet) {
  std::vector<SteadyScan> scans = InStreet(15.0, 0.0, 3000, 3);
  Draws draws(7);
  for (SteadyScan& scan : scans) {
    // 12 m long and 3 m high, 2.5 m to the side: more points than all of the street.
    for (int i = 0; i < 2000; ++i) {
      PointCluster point;
      point.AddPoint({draws.Uniform(-6.0, 6.0), 2.5 + draws.Normal(0.01), draws.Uniform(0.5, 3.5)});
      scan.clusters.push_back(point);
    }
  }
  EXPECT_NEAR(Find(std::move(scans)).motion.speed_m_s, 15.0, 0.4);
}

// As 16 rings 2 degrees apart see it from there, each scan from another azimuth on, past a lorry
// that keeps to the sensor: 12 m long, 2.5 m to the right, up to 2.5 m above the sensor.
std::vector<TimedPoint> RingsPastALorry(const BayStreet& street, const SE3& T, Draws* draws) {
  std::vector<TimedPoint> points;
  const double from_rad = draws->Uniform(0.0, Radians(0.2));
  for (int ring = 0; ring < 16; ++ring) {
    const double elevation = Radians(2.0 * ring - 15.0);
    for (int step = 0; step < 1800; ++step) {
      const double azimuth = from_rad + Radians(0.2 * step - 180.0);
      const Eigen::Vector3d ray(std::cos(elevation) * std::cos(azimuth),
                                std::cos(elevation) * std::sin(azimuth), std::sin(elevation));
      double range = street.Cast(T.t, ray);
      const double beside = ray.y() < 0.0 ? -2.5 / ray.y() : range;
      if (std::abs(beside * ray.x()) < 6.0 && beside * ray.z() < 2.5)
        range = std::min(range, beside);
      if (range > 100.0) continue;
      const Eigen::Vector3f p = ((range + draws->Normal(0.01)) * ray).cast<float>();
      points.push_back({p.x(), p.y(), p.z(), 0.0F});
    }
  }
  return points;
}

// A voxel on a facade has one ring, whose beams lie in a sheet whatever they meet.
TEST(SteadyMotionTest, TheSheetsOfRingsDoNotHoldTheSensor) {
  constexpr double kSpeedMS = 4.65, kStartingMS2 = 3.0;
  for (const unsigned seed : {3U, 4U, 5U}) {
    const BayStreet street(seed);
    Draws draws(9);
    std::vector<SteadyScan> scans;
    for (int k = 0; k < kScans; ++k) {
      const SE3 T = BayStreet::PoseAt(100.0 + SteadyAt(kSpeedMS, kStartingMS2, k));
      const auto clusters = BuildScanClusters(RingsPastALorry(street, T, &draws), 0.5);
      scans.push_back(SteadyScanOf(clusters, T, k));
    }
    const FoundSpeed found = Find(std::move(scans));
    EXPECT_NEAR(found.motion.speed_m_s, kSpeedMS, 0.2) << seed;
    EXPECT_NEAR(found.motion.acceleration_m_s2, kStartingMS2, 1.5) << seed;
    EXPECT_LE(found.open_speed_m_s, 1.0) << seed;
  }
}

TEST(SteadyMotionTest, SaysWhereSpeedCannotBeTold) {
  const World world = World::Corridor();
  Draws draws(5);
  std::vector<SteadyScan> scans;
  for (int k = 0; k < kScans; ++k)
    scans.push_back(
        SteadyScanOf(ScanFrom(SE3(), world.Sample(1500, 0.005, &draws), kSteadyVoxelM), SE3(), k));
  const FoundSpeed found = Find(std::move(scans));
  EXPECT_GT(found.open_speed_m_s, 10.0);
}

TEST(SteadyMotionTest, ASensorInARoomHasNotLeftIt) {
  // At any speed by which the scans have nothing in common, nothing contradicts it either.
  const World room = World::Room();
  Draws draws(6);
  std::vector<SteadyScan> scans;
  for (int k = 0; k < kScans; ++k)
    scans.push_back(
        SteadyScanOf(ScanFrom(SE3(), room.Sample(400, 0.005, &draws), kSteadyVoxelM), SE3(), k));
  const FoundSpeed found = Find(std::move(scans));
  EXPECT_NEAR(found.motion.speed_m_s, 0.0, 0.5);
  EXPECT_LE(found.open_speed_m_s, 1.0);
}

TEST(SteadyMotionTest, PointsOfASweepLieWhereTheyWereSeen) {
  // Clusters measured up to 0.1 s after the stamp, as a sweep at 15 m/s sees them.
  const BayStreet street(4);
  Draws draws(8);
  std::vector<SteadyScan> scans;
  for (int k = 0; k < kScans; ++k) {
    SteadyScan scan;
    scan.time_s = kScanPeriodS * k;
    for (int part = 0; part < 10; ++part) {
      const double after_s = 0.01 * part;
      const SE3 T = BayStreet::PoseAt(100.0 + 15.0 * (scan.time_s + after_s));
      const SteadyScan made = SteadyScanOf(Seen(street, T, 150, &draws), T, k);
      scan.clusters.insert(scan.clusters.end(), made.clusters.begin(), made.clusters.end());
      scan.cluster_times_s.resize(scan.clusters.size(), after_s);
    }
    scans.push_back(std::move(scan));
  }
  EXPECT_NEAR(Find(scans).motion.speed_m_s, 15.0, 0.4);
}

}  // namespace
}  // namespace lamina
