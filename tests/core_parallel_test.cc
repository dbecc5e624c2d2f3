#include "core/parallel.h"

#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <cstring>
#include <stdexcept>

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

TEST(Background, HandsOverWhatItDidAndWhatItThrew) {
  Background background;
  std::vector<int> done;
  for (int i = 0; i < 20; ++i) {
    background.Start([&done, i] { done.push_back(i); });
    background.Wait();
    EXPECT_EQ(done.size(), static_cast<std::size_t>(i) + 1);
  }
  background.Start([] { throw std::runtime_error("no"); });
  EXPECT_THROW(background.Wait(), std::runtime_error);
  background.Start([&done] { done.clear(); });
  background.Wait();
  EXPECT_TRUE(done.empty());
}

// Takes `items` numbers through three stages, and looks at the order of the calls.
class CountingStages final : public PipelineStages {
 public:
  CountingStages(std::size_t items, std::size_t most) : slots(most), items_(items) {}

  bool Begin(std::size_t i) override {
    if (i != begun++) ++wrong;
    if (i >= items_) return false;
    if (i - ended >= slots.size()) ++wrong;
    slots[i % slots.size()] = 0;
    return true;
  }
  void Work(std::size_t i) override { slots[i % slots.size()] += i; }
  void End(std::size_t i) override {
    if (i != ended) ++wrong;
    if (slots[i % slots.size()] != i) ++wrong;
    if (i == bad) throw std::runtime_error("bad item");
    ++ended;
  }

  std::vector<std::size_t> slots;
  std::size_t begun = 0;
  std::atomic<std::size_t> ended{0}, wrong{0};
  std::size_t bad = 1000000;

 private:
  std::size_t items_;
};

TEST(RunPipeline, TakesItemsThroughInOrderAndSoManyAtOnce) {
  for (const std::size_t most : {1U, 2U, 5U}) {
    for (const std::size_t items : {0U, 1U, 500U}) {
      CountingStages stages(items, most);
      RunPipeline(most, &stages);
      EXPECT_EQ(stages.ended, items);
      EXPECT_EQ(stages.wrong, 0U) << most << " at once";
    }
  }
}

TEST(RunPipeline, ThrowsWhatAStageThrew) {
  CountingStages stages(500, 4);
  stages.bad = 100;
  EXPECT_THROW(RunPipeline(4, &stages), std::runtime_error);
  EXPECT_EQ(stages.ended, 100U);
  EXPECT_LE(stages.begun, 105U);
}

}  // namespace
}  // namespace lamina
