#include "frontend/scan_agreement.h"

#include <gtest/gtest.h>

#include "tests/bay_street.h"
#include "tests/random_rooms.h"

namespace lamina {
namespace {

PosePrediction Expected(double along_m) {
  PosePrediction prediction;
  prediction.T_world_lidar = SE3(Eigen::Quaterniond::Identity(), {along_m, 0.0, 0.0});
  prediction.covariance.diagonal().setConstant(0.3);
  return prediction;
}

TEST(ScanAgreement, ScansOfOnePlaceAgreeAndSprayAgreesWithNothing) {
  const BayStreet street(1);
  Draws draws(2);
  const VoxelMapOptions map;
  const ScanMatcher matcher{ScanMatcherOptions()};
  const auto scan = [&](double along_m) {
    return Untimed(
        BuildScanClusters(street.Scan(BayStreet::PoseAt(along_m), 10000, &draws), map.LeafSize()));
  };
  const auto spray = [&] {
    return Untimed(BuildScanClusters(BayStreet::Spray(10000, &draws), map.LeafSize()));
  };
  EXPECT_TRUE(ScansAgree(scan(0.0), scan(1.0), Expected(1.2), map, matcher));
  EXPECT_FALSE(ScansAgree(scan(0.0), spray(), Expected(1.2), map, matcher));
  EXPECT_FALSE(ScansAgree(spray(), scan(1.0), Expected(1.2), map, matcher));
  EXPECT_FALSE(ScansAgree(spray(), spray(), Expected(0.0), map, matcher));
}

}  // namespace
}  // namespace lamina
