#include "core/base/thinning.h"

#include <gtest/gtest.h>

#include <numeric>

namespace lamina {
namespace {

TEST(Thinning, LeavesSoManyAtMostFromAllOfTheScan) {
  for (const std::size_t size : {0, 1, 9, 10, 11, 20, 21, 99, 100}) {
    std::vector<int> all(size);
    std::iota(all.begin(), all.end(), 0);
    const std::vector<int> some = Thinned(all, 10);
    ASSERT_LE(some.size(), 10U) << size;
    if (size <= 10) {
      EXPECT_EQ(some, all);
    } else {
      EXPECT_GT(some.size(), 5U) << size;
      EXPECT_EQ(some.front(), 0);
      EXPECT_GE(some.back() + (some[1] - some[0]), static_cast<int>(size)) << size;
    }
  }
}

TEST(Thinning, LeavesSoManyAtLeastAndFewerThanTwiceAsMany) {
  for (const std::size_t size : {10, 11, 19, 20, 29, 100, 109}) {
    const std::size_t stride = StrideToAtLeast(size, 10), left = (size + stride - 1) / stride;
    EXPECT_GE(left, 10U) << size;
    EXPECT_LT(left, 20U) << size;
  }
  EXPECT_EQ(StrideToAtLeast(3, 10), 1U);
}

}  // namespace
}  // namespace lamina
