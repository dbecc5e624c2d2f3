#include "frontend/start/beam_agreement.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "core/base/angle.h"
#include "frontend/start/resting_beams.h"
#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

constexpr double kSigmaM = 0.06, kNoiseM = 0.02;

// Balls of foliage about the origin.
class Foliage {
 public:
  explicit Foliage(unsigned seed) {
    Draws draws(seed);
    for (int i = 0; i < 900; ++i) {
      const double azimuth = draws.Uniform(-M_PI, M_PI), far_m = draws.Uniform(3.0, 14.0);
      balls_.push_back(
          {{far_m * std::cos(azimuth), far_m * std::sin(azimuth), draws.Uniform(-1.0, 6.0)},
           draws.Uniform(0.15, 0.4)});
    }
  }

  // The strokes of a sparse pattern, turned about the vertical by so much.
  std::vector<PointCluster> Scan(const SE3& T_world_lidar, double turned_deg, Draws* draws,
                                 double noise_m = kNoiseM) const {
    constexpr double kStrokesDeg = 4.6, kAlongDeg = 0.6;
    std::vector<PointCluster> clusters;
    for (double azimuth = turned_deg; azimuth < 360.0 + turned_deg; azimuth += kStrokesDeg) {
      for (double elevation = -7.0; elevation < 52.0; elevation += kAlongDeg) {
        const double a = Radians(azimuth), e = Radians(elevation);
        const Eigen::Vector3d ray(std::cos(e) * std::cos(a), std::cos(e) * std::sin(a),
                                  std::sin(e));
        const double range = Range(T_world_lidar.t, T_world_lidar.q * ray);
        if (!std::isfinite(range)) continue;
        PointCluster point;
        point.AddPoint((range + draws->Normal(noise_m)) * ray);
        clusters.push_back(point);
      }
    }
    return clusters;
  }

 private:
  struct Ball {
    Eigen::Vector3d centre;
    double radius;
  };

  double Range(const Eigen::Vector3d& from, const Eigen::Vector3d& ray) const {
    double nearest = std::numeric_limits<double>::infinity();
    for (const Ball& ball : balls_) {
      const Eigen::Vector3d to = ball.centre - from;
      const double along = to.dot(ray);
      const double inside = ball.radius * ball.radius - (to - along * ray).squaredNorm();
      if (along > 0.0 && inside > 0.0) nearest = std::min(nearest, along - std::sqrt(inside));
    }
    return nearest;
  }

  std::vector<Ball> balls_;
};

// A sensor that walks and turns while its pattern turns on.
struct Pair {
  static constexpr double kPatternDeg = 1.28;
  explicit Pair(unsigned seed) {
    Draws draws(seed + 50);
    const Foliage foliage(seed);
    first = foliage.Scan(SE3(), 0.0, &draws);
    second = foliage.Scan(T_first_second, kPatternDeg, &draws);
  }
  // Where the lines of the second scan lie on those of the first one.
  SE3 LinesOnLines() const {
    return SE3(
        Eigen::Quaterniond(Eigen::AngleAxisd(Radians(-kPatternDeg), Eigen::Vector3d::UnitZ())),
        Eigen::Vector3d::Zero());
  }

  SE3 T_first_second{Eigen::Quaterniond(Eigen::AngleAxisd(Radians(0.4), Eigen::Vector3d::UnitZ())),
                     {0.12, 0.01, -0.02}};
  std::vector<PointCluster> first, second;
};

TEST(BeamAgreementTest, LinesThatLieOnLinesDoNotAgree) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    const Pair pair(seed);
    const BeamAgreement agreement(pair.first, kSigmaM);
    const double right = agreement.Of(pair.second, pair.T_first_second);
    EXPECT_GT(right, 0.35) << seed;
    EXPECT_LT(agreement.Of(pair.second, pair.LinesOnLines()), 0.5 * right) << seed;
  }
}

TEST(BeamAgreementTest, ClimbsFromRestToTheMotion) {
  constexpr double kMostM = 0.06, kMostDeg = 0.6;
  for (unsigned seed = 1; seed <= 5; ++seed) {
    const Pair pair(seed);
    const BeamAgreement agreement(pair.first, kSigmaM);
    const SE3 T = agreement.Climb(pair.second, SE3());
    EXPECT_LT((T.t - pair.T_first_second.t).norm(), kMostM) << seed;
    EXPECT_LT(Degrees(RotationAngle(T, pair.T_first_second)), kMostDeg) << seed;
  }
}

TEST(BeamAgreementTest, AScanThatMeetsNothingOrHasNoPointsAgreesInNothing) {
  const Pair pair(1);
  const BeamAgreement agreement(pair.first, kSigmaM);
  EXPECT_EQ(agreement.Of({}, SE3()), 0.0);
  const SE3 far(Eigen::Quaterniond::Identity(), {500.0, 0.0, 0.0});
  EXPECT_LT(agreement.Of(pair.second, far), 0.05);
  const BeamAgreement none({}, kSigmaM);
  EXPECT_EQ(none.Of(pair.second, SE3()), 0.0);
  EXPECT_LT((none.Climb(pair.second, SE3()).t).norm(), 1e-12);
}

// Straight up there is no azimuth, and a point at the sensor has no direction.
TEST(BeamAgreementTest, PointsOverheadAndAtTheSensorAreLeftOut) {
  std::vector<PointCluster> clusters(2);
  clusters[0].AddPoint({0.0, 0.0, 5.0});
  clusters[1].AddPoint({0.0, 0.0, 0.0});
  const BeamAgreement agreement(clusters, kSigmaM);
  EXPECT_EQ(agreement.Of(clusters, SE3()), 0.0);
}

// Scans of a sensor on its way, each of a pattern that has turned on by so much.
std::vector<std::vector<TimedCluster>> ScansAlong(double step_m, double turned_deg,
                                                  double noise_m) {
  Draws draws(9);
  const Foliage foliage(3);
  std::vector<std::vector<TimedCluster>> scans;
  for (int k = 0; k < 6; ++k) {
    const SE3 T(Eigen::Quaterniond::Identity(), {k * step_m, 0.0, 0.0});
    scans.emplace_back();
    for (const PointCluster& points : foliage.Scan(T, k * turned_deg, &draws, noise_m)) {
      TimedCluster cluster;
      cluster.points = points;
      scans.back().push_back(cluster);
    }
  }
  return scans;
}

TEST(RestingBeamsTest, WhatIsRepeatedEndsWhereItDidIfTheSensorRests) {
  const auto contradictions = [](double step_m, double turned_deg, double claimed_m,
                                 double noise_m = kNoiseM) {
    RestingBeams beams(kNoiseM);
    int k = 0, count = 0;
    for (const std::vector<TimedCluster>& scan : ScansAlong(step_m, turned_deg, noise_m)) {
      const SE3 T(Eigen::Quaterniond::Identity(), {claimed_m * k++, 0.0, 0.0});
      beams.Add(scan, T);
      count += beams.Contradict() ? 1 : 0;
      EXPECT_EQ(beams.contradictions(), count);
    }
    return count;
  };
  EXPECT_EQ(contradictions(0.0, 0.0, 0.0), 0);
  EXPECT_EQ(contradictions(0.4, 0.0, 0.0), 5);
  // In noise four times as large as is known of.
  EXPECT_EQ(contradictions(0.0, 0.0, 0.0, 4.0 * kNoiseM), 0);
  // Where it is known to have moved, and where rays are not repeated, none is asked.
  EXPECT_EQ(contradictions(0.4, 0.0, 0.4), 0);
  EXPECT_EQ(contradictions(0.4, 1.28, 0.0), 0);
}

}  // namespace
}  // namespace lamina
