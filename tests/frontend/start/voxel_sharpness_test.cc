#include "frontend/start/voxel_sharpness.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <cmath>
#include <numeric>
#include <random>
#include <vector>

namespace lamina {
namespace {

constexpr double kNoise2 = 1e-4;

struct Voxels {
  std::vector<VoxelPlan> plans;
  std::vector<VoxelHeights> heights;
  std::vector<double> in_plan, in_space;  // what is right

  // Of points with these standard deviations about three directions.
  void Add(const Eigen::Vector3d& sigmas_m, std::mt19937_64* random) {
    std::normal_distribution<double> normal;
    std::uniform_int_distribution<int> points(5, 300);
    const Eigen::Quaterniond turned =
        Eigen::Quaterniond(normal(*random), normal(*random), normal(*random), normal(*random))
            .normalized();
    const Eigen::Vector3d middle(0.1 * normal(*random), 0.1 * normal(*random), 0.2);
    VoxelPlan plan;
    VoxelHeights height;
    for (int i = points(*random); i > 0; --i) {
      const Eigen::Vector3d along(normal(*random), normal(*random), normal(*random));
      const Eigen::Vector3f p = (middle + turned * along.cwiseProduct(sigmas_m)).cast<float>();
      plan.n += 1.0F;
      plan.x += p.x();
      plan.y += p.y();
      plan.xx += p.x() * p.x();
      plan.xy += p.x() * p.y();
      plan.yy += p.y() * p.y();
      height.z += p.z();
      height.xz += p.x() * p.z();
      height.yz += p.y() * p.z();
      height.zz += p.z() * p.z();
    }
    // From the same sums: what is tested is the eigenvalue, not how sums are rounded.
    const double n = plan.n;
    const Eigen::Vector3d mean(plan.x / n, plan.y / n, height.z / n);
    Eigen::Matrix3d covariance;
    covariance << plan.xx / n, plan.xy / n, height.xz / n, plan.xy / n, plan.yy / n, height.yz / n,
        height.xz / n, height.yz / n, height.zz / n;
    covariance -= mean * mean.transpose();
    const auto sharpness = [](double variance) {
      return -0.5 * std::log(std::max(0.0, variance) + kNoise2);
    };
    const Eigen::Matrix2d below = covariance.topLeftCorner<2, 2>();
    in_plan.push_back(
        sharpness(Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(below).eigenvalues()(0)));
    in_space.push_back(
        sharpness(Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(covariance).eigenvalues()(0)));
    plans.push_back(plan);
    heights.push_back(height);
  }

  std::vector<float> Found(const std::vector<std::int32_t>& places, bool space) const {
    std::vector<float> found(plans.size(), 0.0F);
    FindSharpness(plans.data(), space ? heights.data() : nullptr, places.data(), places.size(),
                  kNoise2, found.data());
    return found;
  }
};

Voxels ManyVoxels() {
  std::mt19937_64 random(3);
  Voxels voxels;
  for (int i = 0; i < 200; ++i) {
    voxels.Add({0.2, 0.2, 0.01}, &random);     // planes
    voxels.Add({0.2, 0.002, 0.002}, &random);  // lines: two eigenvalues are the same
    voxels.Add({0.2, 0.1, 0.05}, &random);
    voxels.Add({0.1, 0.1, 0.1}, &random);  // three are nearly the same
    voxels.Add({0.0, 0.0, 0.0}, &random);  // and here all are zero
  }
  return voxels;
}

TEST(VoxelSharpness, IsThatOfTheSmallestEigenvalue) {
  const Voxels voxels = ManyVoxels();
  std::vector<std::int32_t> places(voxels.plans.size());
  std::iota(places.begin(), places.end(), 0);
  const std::vector<float> plan = voxels.Found(places, false), space = voxels.Found(places, true);
  for (std::size_t i = 0; i < places.size(); ++i) {
    EXPECT_NEAR(plan[i], voxels.in_plan[i], 1e-4) << i;
    EXPECT_NEAR(space[i], voxels.in_space[i], 1e-4) << i;
  }
}

TEST(VoxelSharpness, IsThatOfTheVoxelAlone) {
  const Voxels voxels = ManyVoxels();
  std::vector<std::int32_t> all(voxels.plans.size());
  std::iota(all.begin(), all.end(), 0);
  for (const bool in_space : {false, true}) {
    const std::vector<float> together = voxels.Found(all, in_space);
    for (const std::int32_t place : {0, 1, 7, 42, 997}) {
      const std::vector<float> alone = voxels.Found({place}, in_space);
      for (std::size_t i = 0; i < alone.size(); ++i)
        EXPECT_EQ(alone[i], i == static_cast<std::size_t>(place) ? together[i] : 0.0F);
    }
  }
  EXPECT_EQ(voxels.Found({}, true), std::vector<float>(voxels.plans.size(), 0.0F));
}

}  // namespace
}  // namespace lamina
