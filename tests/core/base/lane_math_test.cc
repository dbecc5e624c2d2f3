#include "core/base/lane_math.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

namespace lamina {
namespace {

TEST(LaneMath, LogarithmsAreThoseOfTheLibrary) {
  std::mt19937_64 random(5);
  std::uniform_real_distribution<double> exponent(-300.0, 300.0);
  for (int i = 0; i < 1000; ++i) {
    Four x;
    for (int k = 0; k < 4; ++k) x[k] = std::pow(10.0, exponent(random));
    const Four numbers = x;
    Logarithms(&x);
    for (int k = 0; k < 4; ++k)
      EXPECT_NEAR(x[k], std::log(numbers[k]), 1e-10 * std::max(1.0, std::abs(x[k])));
  }
}

TEST(LaneMath, LogarithmsHaveNoStepWhereTheExponentChanges) {
  const double root = std::sqrt(2.0);
  for (const double at : {0.5, 1.0, root, 2.0, 2.0 * root, 1e-4}) {
    Four x{std::nextafter(at, 0.0), at, std::nextafter(at, 4.0), 1.0};
    Logarithms(&x);
    for (int k = 0; k < 3; ++k) EXPECT_NEAR(x[k], std::log(at), 1e-10);
    EXPECT_EQ(x[3], 0.0);
  }
}

TEST(LaneMath, SquareRootsAreExact) {
  Four x{0.0, 2.0, 1e-300, 1e300};
  SquareRoots(&x);
  EXPECT_EQ(x[0], 0.0);
  EXPECT_EQ(x[1], std::sqrt(2.0));
  EXPECT_EQ(x[2], 1e-150);
  EXPECT_EQ(x[3], 1e150);
}

TEST(LaneMath, AnyLaneIsOne) {
  EXPECT_FALSE(AnyLane(FourIntegers{}));
  for (int k = 0; k < 4; ++k) {
    FourIntegers bits{};
    bits[k] = -1;
    EXPECT_TRUE(AnyLane(bits));
  }
}

}  // namespace
}  // namespace lamina
