#include "frontend/matching/match_rows.h"

#include <gtest/gtest.h>

#include <Eigen/QR>
#include <algorithm>
#include <random>
#include <vector>

#include "core/geometry/degeneracy.h"
#include "core/geometry/robust_kernel.h"
#include "frontend/matching/line_of_sight.h"
#include "frontend/matching/map_residuals.h"
#include "frontend/matching/scan_matcher.h"

namespace lamina {
namespace {

// Clusters near planes of a room, some of them farther off than a match may be.
class MatchRowsTest : public ::testing::Test {
 protected:
  MatchRowsTest() {
    settings_.R = Eigen::Quaterniond(Random4().normalized()).toRotationMatrix();
    settings_.t = 3.0 * Random3();
    settings_.kernel_sigma = 2.0;
    settings_.most_weight = 4.0;
    settings_.floor2 = 4e-4;
    settings_.beam2 = 1e-4;
    for (int i = 0; i < kCount; ++i) {
      PointCluster cluster;
      for (int k = 0; k < 1 + i % 9; ++k)
        cluster.AddPoint(Eigen::Vector3d(10.0 * direction_ + 0.1 * Random3()));
      direction_ = Random3().normalized();
      Surface surface;
      surface.kind = Surface::Kind::kPlane;
      surface.normal = Random3().normalized().cast<float>();
      surface.mean = settings_.R * cluster.mean + settings_.t + 0.3 * Random3();
      surface.variance = i % 7 == 0 ? 0.0F : 1e-4F * static_cast<float>(1 + i % 5);
      surface.flatness = 1e-3F * static_cast<float>(1 + i % 11);
      surface.frames = static_cast<std::uint16_t>(i % 6);
      clusters_.push_back(cluster);
      surfaces_.push_back(surface);
    }
    options_.max_distance_m = 0.25;
    options_.young_frames = 3;
    for (int i = 0; i < kCount; ++i) {
      cluster_of_.push_back(&clusters_[static_cast<std::size_t>(i)]);
      surface_of_.push_back(&surfaces_[static_cast<std::size_t>(i)]);
    }
  }

  Eigen::Vector3d Random3() { return {normal_(random_), normal_(random_), normal_(random_)}; }
  Eigen::Vector4d Random4() {
    Eigen::Vector4d v;
    v << Random3(), normal_(random_);
    return v;
  }
  std::vector<MatchRow> Rows(std::size_t count) const {
    std::vector<MatchRow> rows(count);
    MakePlaneRows(cluster_of_.data(), surface_of_.data(), count, settings_, options_, rows.data());
    return rows;
  }

  static constexpr int kCount = 203;
  std::mt19937 random_{7};
  std::normal_distribution<double> normal_;
  Eigen::Vector3d direction_ = Eigen::Vector3d::UnitX();
  RowSettings settings_;
  ScanMatcherOptions options_;
  std::vector<PointCluster> clusters_;
  std::vector<Surface> surfaces_;
  std::vector<const PointCluster*> cluster_of_;
  std::vector<const Surface*> surface_of_;
};

TEST_F(MatchRowsTest, AreTheCostOfTheScanMatcher) {
  const std::vector<MatchRow> rows = Rows(kCount);
  int matched = 0, young = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    SCOPED_TRACE(i);
    const PointCluster& cluster = clusters_[i];
    const Surface& surface = surfaces_[i];
    const MatchRow& row = rows[i];
    const Eigen::Vector3d normal = surface.normal.cast<double>();
    const Eigen::Vector3d normal_lidar = settings_.R.transpose() * normal;
    const double distance = normal.dot(settings_.R * cluster.mean + settings_.t - surface.mean);
    EXPECT_NEAR(row.distance, distance, 1e-12);
    EXPECT_EQ(row.matched, std::abs(distance) <= options_.max_distance_m);
    EXPECT_FALSE(row.rough);
    const double breadth2 = static_cast<double>(surface.variance / surface.flatness);
    EXPECT_NEAR(row.normal_error2,
                NormalError2(static_cast<double>(surface.variance), breadth2, settings_.beam2),
                1e-9 * row.normal_error2);
    if (!row.matched) {
      EXPECT_EQ(row.w, 0.0);
      EXPECT_EQ(row.robust, 0.0);
      EXPECT_EQ(row.residual2, 0.0);
      continue;
    }
    ++matched;
    const double variance = DistanceVariance(cluster, normal_lidar, surface, settings_.floor2);
    const double scale2 = variance * settings_.kernel_sigma * settings_.kernel_sigma;
    const double robust = GemanMcClureWeight(distance * distance / scale2);
    const bool is_young =
        surface.frames < options_.young_frames && AlongSight(normal_lidar, cluster.mean);
    young += is_young ? 1 : 0;
    EXPECT_EQ(row.young, is_young);
    const double doubt = is_young ? options_.young_sigma_m * options_.young_sigma_m : 0.0;
    const double w = SightWeight(surface, normal_lidar, cluster.mean) * robust *
                     std::min(cluster.count, settings_.most_weight) / (variance + doubt);
    EXPECT_NEAR(row.robust, robust, 1e-10);
    EXPECT_NEAR(row.residual2, robust * distance * distance, 1e-12);
    EXPECT_NEAR(row.w, w, 1e-9 * (1.0 + w));
    Vector6d j;
    j << cluster.mean.cross(normal_lidar), normal;
    EXPECT_LT((Eigen::Map<const Vector6d>(row.j) - j).norm(), 1e-11);
  }
  EXPECT_GT(matched, 50);
  EXPECT_LT(matched, kCount);
  EXPECT_GT(young, 3);
}

TEST_F(MatchRowsTest, PlanesMetFlatlyWeighNothingIfTheyAreLeftOut) {
  const std::vector<MatchRow> with = Rows(kCount);
  settings_.use_flat = false;
  const std::vector<MatchRow> without = Rows(kCount);
  int flat = 0, old = 0;
  for (std::size_t i = 0; i < with.size(); ++i) {
    const Eigen::Vector3d& sight = clusters_[i].mean;
    const double along = (settings_.R.transpose() * surfaces_[i].normal.cast<double>()).dot(sight);
    const bool is_flat = std::abs(along) < kFlatSine * sight.norm();
    EXPECT_EQ(without[i].w, is_flat ? 0.0 : with[i].w) << i;
    // What meets them is matched all the same.
    EXPECT_EQ(without[i].matched, with[i].matched) << i;
    EXPECT_EQ(without[i].robust, with[i].robust) << i;
    flat += is_flat && with[i].matched ? 1 : 0;
    old += !is_flat && with[i].matched && !with[i].young ? 1 : 0;
  }
  EXPECT_GT(flat, 3);
  RowSums sums;
  sums.Add(without.data(), without.size());
  EXPECT_EQ(sums.matched_old, old);
}

TEST_F(MatchRowsTest, DoNotDependOnWhichOthersTheyAreMadeWith) {
  const std::vector<MatchRow> all = Rows(kCount);
  for (std::size_t count = 1; count <= 9; ++count) {
    const std::vector<MatchRow> some = Rows(count);
    for (std::size_t i = 0; i < count; ++i) {
      SCOPED_TRACE(i);
      EXPECT_EQ(some[i].w, all[i].w);
      EXPECT_EQ(some[i].distance, all[i].distance);
      EXPECT_TRUE(std::equal(some[i].j, some[i].j + 6, all[i].j));
    }
  }
}

// A row buffer is used again; what an axis of a rough leaf left in it must not stay.
TEST_F(MatchRowsTest, ForgetWhatTheirPlacesHeld) {
  std::vector<MatchRow> rows(5);
  for (MatchRow& row : rows) row.rough = row.young = row.matched = true;
  const std::vector<MatchRow> fresh = Rows(rows.size());
  MakePlaneRows(cluster_of_.data(), surface_of_.data(), rows.size(), settings_, options_,
                rows.data());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    EXPECT_FALSE(rows[i].rough);
    EXPECT_EQ(rows[i].young, fresh[i].young);
    EXPECT_EQ(rows[i].matched, fresh[i].matched);
  }
}

TEST_F(MatchRowsTest, SumToNormalEquations) {
  const std::vector<MatchRow> rows = Rows(kCount);
  RowSums sums;
  sums.Add(rows.data(), 100);
  sums.Add(rows.data() + 100, rows.size() - 100);
  TwoStepRows two;
  Matrix6d H = Matrix6d::Zero(), across = Matrix6d::Zero(), other = Matrix6d::Zero();
  Vector6d g = Vector6d::Zero(), g_pose = Vector6d::Zero(), g_other = Vector6d::Zero();
  double weight = 0.0, robust = 0.0, residual2 = 0.0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const MatchRow& row = rows[i];
    const StepShares shares{1.0 + 0.01 * static_cast<double>(i % 8),
                            0.1 * static_cast<double>(i % 5)};
    two.Add(row, shares);
    const Vector6d j = Eigen::Map<const Vector6d>(row.j);
    H += row.w * j * j.transpose();
    g += row.w * row.distance * j;
    across += row.w * shares.pose * shares.other * j * j.transpose();
    other += row.w * shares.other * shares.other * j * j.transpose();
    g_pose += row.w * shares.pose * row.distance * j;
    g_other += row.w * shares.other * row.distance * j;
    weight += row.w;
    robust += row.robust;
    residual2 += row.residual2;
  }
  const auto alike = [](const auto& a, const auto& b) {
    return (a - b).norm() < 1e-10 * (1.0 + b.norm());
  };
  EXPECT_TRUE(alike(sums.H(), H));
  EXPECT_TRUE(alike(sums.g(), g));
  EXPECT_NEAR(sums.weight(), weight, 1e-9 * weight);
  EXPECT_NEAR(sums.robust(), robust, 1e-9);
  EXPECT_NEAR(sums.residual2(), residual2, 1e-9);
  EXPECT_TRUE(alike(two.across.H(), across));
  EXPECT_TRUE(alike(two.other.H(), other));
  EXPECT_TRUE(alike(two.pose.g(), g_pose));
  EXPECT_TRUE(alike(two.other.g(), g_other));
  TwoStepRows twice = two;
  twice += two;
  EXPECT_TRUE(alike(twice.other.H(), Matrix6d(2.0 * other)));
}

TEST_F(MatchRowsTest, EvidenceIsThatOfOneRowAfterTheOtherToTheBit) {
  Matrix6d directions;
  for (int c = 0; c < 6; ++c) directions.col(c) << Random3(), Random3();
  directions = directions.householderQr().householderQ() * Matrix6d::Identity();
  const std::vector<MatchRow> rows = Rows(kCount);
  std::vector<std::size_t> of;
  DirectionEvidence all, old;
  all.directions = old.directions = directions;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    of.push_back(i);
    const Vector6d j = DividedByArm(Vector6d(Eigen::Map<const Vector6d>(rows[i].j)));
    const double arm = clusters_[i].mean.norm() / kRotationArmM;
    all.Add(j, rows[i].w, rows[i].normal_error2, arm, 1.0);
    if (!rows[i].young) old.Add(j, rows[i].w, rows[i].normal_error2, arm, 1.0);
  }
  EvidenceSums sums(directions);
  sums.Add(rows.data(), of.data(), rows.size(), clusters_.data());
  DirectionEvidence in_lanes;
  EvidenceSums::Store(sums.all, &in_lanes);
  EXPECT_EQ(in_lanes.information, all.information);
  EXPECT_EQ(in_lanes.squares, all.squares);
  EvidenceSums::Store(sums.old, &in_lanes);
  EXPECT_EQ(in_lanes.information, old.information);
  EXPECT_EQ(in_lanes.squares, old.squares);
}

}  // namespace
}  // namespace lamina
