#include "frontend/matching/seen_through.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace lamina {
namespace {

PointCluster ClusterAt(const std::vector<Eigen::Vector3d>& points) {
  PointCluster cluster;
  for (const Eigen::Vector3d& p : points) cluster.AddPoint(p);
  return cluster;
}

// A plane across x at 10 m, of these points.
Surface PlaneOf(const PointCluster& members) {
  Surface plane;
  plane.kind = Surface::Kind::kPlane;
  plane.mean = members.mean;
  plane.normal = Eigen::Vector3f::UnitX();
  return plane;
}

// Clusters of one point each where the beams to a board of 1 m by 1 m at 10 m end, `behind` of
// every ten of them that much farther off.
std::vector<PointCluster> BeamsToBoard(int behind, double farther_m) {
  std::vector<PointCluster> clusters;
  for (int i = 0; i < 100; ++i) {
    const Eigen::Vector3d p(10.0, 0.1 * (i / 10) - 0.45, 0.1 * (i % 10) - 0.45);
    const bool passes = i % 10 < behind;
    clusters.push_back(ClusterAt({passes ? Eigen::Vector3d(p * (1.0 + farther_m / 10.0)) : p}));
  }
  return clusters;
}

bool BoardSeenThrough(int behind, double farther_m) {
  PointCluster members;
  for (const PointCluster& cluster : BeamsToBoard(0, 0.0)) members += cluster;
  return BeamsOfScan(BeamsToBoard(behind, farther_m), SE3())
      .SeeThrough(PlaneOf(members), members, 10.0 * (10 - behind));
}

TEST(SeenThrough, APlaneThatBeamsEndOnIsNot) {
  EXPECT_FALSE(BoardSeenThrough(0, 5.0));
  EXPECT_FALSE(BoardSeenThrough(2, 5.0));
}

TEST(SeenThrough, APlaneThatBeamsPassIs) {
  EXPECT_TRUE(BoardSeenThrough(4, 5.0));
  EXPECT_TRUE(BoardSeenThrough(9, 5.0));
}

TEST(SeenThrough, AStepBehindAPlaneIsNoHoleInIt) { EXPECT_FALSE(BoardSeenThrough(5, 0.15)); }

TEST(SeenThrough, WhatPassesBesideAPlaneOrEndsBeforeItSaysNothing) {
  PointCluster members;
  for (const PointCluster& cluster : BeamsToBoard(0, 0.0)) members += cluster;
  const std::vector<PointCluster> beside = {
      ClusterAt({{20.0, 4.0, 0.0}}), ClusterAt({{20.0, 0.0, -4.0}}), ClusterAt({{-20.0, 0.0, 0.0}}),
      ClusterAt({{5.0, 0.0, 0.0}})};
  EXPECT_FALSE(BeamsOfScan(beside, SE3()).SeeThrough(PlaneOf(members), members, 1.0));
  // The same from the other side, and of a sensor that is turned.
  const SE3 T(ExpSO3(Eigen::Vector3d(0.0, 0.0, M_PI)), Eigen::Vector3d(20.0, 0.0, 0.0));
  EXPECT_FALSE(
      BeamsOfScan({ClusterAt({{8.0, 0.0, 0.0}})}, T).SeeThrough(PlaneOf(members), members, 1.0));
  EXPECT_TRUE(
      BeamsOfScan({ClusterAt({{15.0, 0.0, 0.0}})}, T).SeeThrough(PlaneOf(members), members, 1.0));
}

}  // namespace
}  // namespace lamina
