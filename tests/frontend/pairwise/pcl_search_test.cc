// The k-d tree that PCL's methods search with, against a look at every point.
#include "frontend/pairwise/pcl_search.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <set>
#include <stdexcept>
#include <utility>
#include <vector>

namespace lamina {
namespace {

using testing::ElementsAreArray;
using testing::UnorderedElementsAreArray;
using Cloud = pcl::PointCloud<pcl::PointXYZ>;

Cloud::Ptr RandomCloud(std::size_t size) {
  std::mt19937 random(3);
  std::uniform_real_distribution<float> uniform(-2.0F, 2.0F);
  auto cloud = pcl::make_shared<Cloud>();
  for (std::size_t i = 0; i < size; ++i) {
    cloud->emplace_back(uniform(random), uniform(random), 0.2F * uniform(random));
  }
  return cloud;
}

// All points by their squared distance, nearest first.
std::vector<std::pair<float, int>> ByDistance(const Cloud& cloud, const pcl::PointXYZ& from) {
  std::vector<std::pair<float, int>> order;
  for (std::size_t i = 0; i < cloud.size(); ++i) {
    order.emplace_back((cloud[i].getVector3fMap() - from.getVector3fMap()).squaredNorm(),
                       static_cast<int>(i));
  }
  std::sort(order.begin(), order.end());
  return order;
}

TEST(PclSearch, FindsTheNearestPointsInOrder) {
  const auto cloud = RandomCloud(700);
  PclSearch<pcl::PointXYZ> search;
  search.setInputCloud(cloud);
  for (const int k : {1, 15, 700, 1000}) {
    for (std::size_t i = 0; i < 20; ++i) {
      pcl::PointXYZ from = (*cloud)[i];
      from.x += 0.01F;
      pcl::Indices indices;
      std::vector<float> distances;
      const int found = search.nearestKSearch(from, k, indices, distances);
      ASSERT_EQ(found, std::min(k, 700));
      // Points that are equally far, but for rounding, may change places.
      const auto all = ByDistance(*cloud, from);
      std::set<int> distinct(indices.begin(), indices.end());
      EXPECT_EQ(distinct.size(), indices.size());
      for (std::size_t n = 0; n < indices.size(); ++n) {
        const auto& at = (*cloud)[static_cast<std::size_t>(indices[n])];
        EXPECT_NEAR(distances[n], all[n].first, 1e-5);
        EXPECT_NEAR((at.getVector3fMap() - from.getVector3fMap()).squaredNorm(), distances[n],
                    1e-5);
      }
    }
  }
}

TEST(PclSearch, FindsAllWithinARadiusOrTheNearestOfThem) {
  const auto cloud = RandomCloud(700);
  PclSearch<pcl::PointXYZ> search;
  search.setInputCloud(cloud);
  constexpr float kRadius = 0.5F;
  for (std::size_t i = 0; i < 50; ++i) {
    const pcl::PointXYZ from = (*cloud)[i];
    std::vector<int> expected;
    for (const auto& [distance2, index] : ByDistance(*cloud, from)) {
      if (distance2 < kRadius * kRadius) expected.push_back(index);
    }
    ASSERT_GT(expected.size(), 3U);
    pcl::Indices indices;
    std::vector<float> distances;
    // By index, as PCL's features ask.
    search.radiusSearch(static_cast<int>(i), kRadius, indices, distances);
    EXPECT_THAT(indices, UnorderedElementsAreArray(expected));
    EXPECT_TRUE(std::is_sorted(distances.begin(), distances.end()));
    EXPECT_EQ(distances.size(), indices.size());
    search.radiusSearch(from, kRadius, indices, distances, 3);
    expected.resize(3);
    EXPECT_THAT(indices, ElementsAreArray(expected));
  }
  pcl::Indices none;
  std::vector<float> distances;
  EXPECT_EQ(search.radiusSearch(pcl::PointXYZ(9.0F, 0.0F, 0.0F), kRadius, none, distances), 0);
  EXPECT_TRUE(none.empty());
}

// As PCL's correspondences want it, which read the first distance whatever was found.
TEST(PclSearch, NothingIsNearAPointThatIsNotFinite) {
  PclSearch<pcl::PointXYZ> search;
  search.setInputCloud(RandomCloud(100));
  const float nan = std::numeric_limits<float>::quiet_NaN();
  pcl::Indices indices;
  std::vector<float> distances;
  EXPECT_EQ(search.nearestKSearch(pcl::PointXYZ(nan, 0.0F, 0.0F), 1, indices, distances), 0);
  ASSERT_EQ(distances.size(), 1U);
  EXPECT_TRUE(std::isinf(distances[0]));
}

TEST(PclSearch, RefusesAPartOfACloud) {
  PclSearch<pcl::PointXYZ> search;
  const auto part = pcl::make_shared<pcl::Indices>(3);
  EXPECT_THROW(search.setInputCloud(RandomCloud(9), part), std::logic_error);
}

}  // namespace
}  // namespace lamina
