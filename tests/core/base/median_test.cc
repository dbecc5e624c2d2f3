#include "core/base/median.h"

#include <gtest/gtest.h>

#include <cmath>

namespace lamina {
namespace {

TEST(Median, IsTheMiddleOrTheMeanOfTheTwoThere) {
  EXPECT_EQ(Median({3.0}), 3.0);
  EXPECT_EQ(Median({5.0, 1.0, 3.0}), 3.0);
  EXPECT_EQ(Median({4.0, 1.0, 3.0, 100.0}), 3.5);
  EXPECT_TRUE(std::isnan(Median({})));
  const double inf = std::numeric_limits<double>::infinity();
  EXPECT_EQ(Median({1.0, inf, inf, inf}), inf);
}

TEST(Median, TheUpperOneIsOneOfTheValues) {
  std::vector<float> values = {4.0F, 1.0F, 3.0F, 100.0F};
  EXPECT_EQ(UpperMedian(&values), 4.0F);
  std::vector<int> odd = {9, 2, 7};
  EXPECT_EQ(UpperMedian(&odd), 7);
}

}  // namespace
}  // namespace lamina
