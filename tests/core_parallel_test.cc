#include "core/parallel.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <cstring>

#include "tests/random_scenes.h"

namespace lamina {
namespace {

TEST(ParallelSum, HasTheSameBitsAtAnyNumberOfThreads) {
  Draws draws(1);
  std::vector<double> values;
  for (int i = 0; i < 200003; ++i) {
    values.push_back(draws.Normal(1.0) * std::pow(10.0, draws.Uniform(-8.0, 8.0)));
  }
  const auto sum_with = [&](std::size_t threads) {
    const ThreadLimit limit(threads);
    return ParallelSum(values.size(), 100, 0.0, [&](std::size_t begin, std::size_t end) {
      double sum = 0.0;
      for (std::size_t i = begin; i < end; ++i) sum += values[i];
      return sum;
    });
  };
  const double one = sum_with(1);
  for (const std::size_t threads : {1U, 2U, 4U, 4U, 4U}) {
    const double again = sum_with(threads);
    EXPECT_EQ(std::memcmp(&one, &again, sizeof(one)), 0) << threads << " threads";
  }
  // The order matters for these numbers: backwards the bits differ.
  double backwards = 0.0;
  for (auto v = values.rbegin(); v != values.rend(); ++v) backwards += *v;
  EXPECT_NE(std::memcmp(&one, &backwards, sizeof(one)), 0);
  EXPECT_NEAR(one / backwards, 1.0, 1e-6);
}

TEST(ParallelChunks, VisitsEveryElementOnceInChunksOfTheGivenSize) {
  for (const std::size_t size : {0U, 1U, 99U, 100U, 101U, 1000U, 1001U}) {
    std::vector<std::atomic<int>> visits(size);
    std::atomic<int> odd_chunks{0};
    ParallelChunks(size, 100, [&](std::size_t begin, std::size_t end) {
      if (begin % 100 != 0 || (end % 100 != 0 && end != size) || end - begin > 100) ++odd_chunks;
      for (std::size_t i = begin; i < end; ++i) ++visits[i];
    });
    EXPECT_EQ(odd_chunks, 0);
    for (const auto& count : visits) EXPECT_EQ(count, 1);
  }
}

TEST(ParallelSum, OfNothingIsZeroAndNestingWorks) {
  const auto none = [](std::size_t, std::size_t) { return 1; };
  EXPECT_EQ(ParallelSum(0, 10, 0, none), 0);
  const int nested = ParallelSum(100, 7, 0, [](std::size_t begin, std::size_t end) {
    return ParallelSum(end - begin, 2, 0,
                       [](std::size_t b, std::size_t e) { return static_cast<int>(e - b); });
  });
  EXPECT_EQ(nested, 100);
}

}  // namespace
}  // namespace lamina
