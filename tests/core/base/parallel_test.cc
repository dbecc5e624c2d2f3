#include "core/base/parallel.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstring>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>

#include "tests/support/scenes/random_scenes.h"

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

// An error that is on its way may meet work that fails as well: the first reaches its handler.
TEST(Background, AnErrorOnItsWayIsNotEndedByWorkThatFails) {
  const auto fail = [] {
    Background background;
    background.Start([] { throw std::runtime_error("out of memory"); });
    throw std::runtime_error("disk is full");
  };
  for (int i = 0; i < 100; ++i) {
    try {
      fail();
      FAIL();
    } catch (const std::runtime_error& error) {
      EXPECT_STREQ(error.what(), "disk is full");
    }
  }
  // Nor is one that comes when nothing else is wrong: who wants to know it waits.
  Background background;
  background.Start([] { throw std::runtime_error("out of memory"); });
}

TEST(ParallelChunks, ThrowsWhatTheFirstChunkThrewAtAnyNumberOfThreads) {
  Draws draws(3);
  for (int round = 0; round < 300; ++round) {
    const ThreadLimit limit(static_cast<std::size_t>(draws.Integer(1, 4)));
    std::vector<char> bad(40);
    for (char& b : bad) b = draws.Integer(0, 9) == 0;
    const std::size_t first =
        static_cast<std::size_t>(std::find(bad.begin(), bad.end(), 1) - bad.begin());
    std::vector<std::atomic<int>> visits(bad.size());
    std::optional<std::size_t> thrown;
    try {
      ParallelChunks(bad.size(), 1, [&](std::size_t i, std::size_t) {
        ++visits[i];
        if (bad[i] != 0) throw i;
      });
    } catch (const std::size_t i) {
      thrown = i;
    }
    ASSERT_EQ(thrown.value_or(bad.size()), first);
    for (std::size_t i = 0; i < first; ++i) ASSERT_EQ(visits[i], 1);
  }
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

// Which call of which item fails is drawn beforehand. Work has a parallel loop within, and beside
// the items something runs in the background, as in the mapping.
class FailingStages final : public PipelineStages {
 public:
  struct Failure {
    std::size_t item = 0;
    int stage = 0;

    bool operator==(const Failure& o) const { return item == o.item && stage == o.stage; }
  };

  FailingStages(Draws* draws, std::size_t most) : slots_(most), failing_(kItems, 3) {
    for (int i = draws->Integer(0, 3); i > 0; --i) {
      failing_[static_cast<std::size_t>(draws->Integer(0, kItems - 1))] = draws->Integer(0, 2);
    }
    background_fails_ = draws->Integer(0, 3) == 0;
  }

  bool Begin(std::size_t i) override {
    if (i >= kItems) return false;
    slots_[i % slots_.size()] = std::make_unique<std::string>(std::to_string(i));
    FailIf(i, 0);
    return true;
  }
  void Work(std::size_t i) override {
    ParallelChunks(4, 1, [&](std::size_t chunk, std::size_t) {
      // Now and then long enough for other threads to take part.
      if (i % 8 == chunk) std::this_thread::sleep_for(std::chrono::microseconds(10));
      if (chunk % 2 == 1) FailIf(i, 1);
    });
    *slots_[i % slots_.size()] += "!";
  }
  void End(std::size_t i) override {
    if (i != ended) throw std::logic_error("items end out of order");
    if (*slots_[i % slots_.size()] != std::to_string(i) + "!") throw std::logic_error("not worked");
    if (i % 3 == 0) {
      if (i > 0 && !background_fails_) background_.Wait();
      if (i == 0 || !background_fails_) background_.Start([this] { Solve(); });
    }
    FailIf(i, 2);
    ++ended;
  }

  // What comes out, whatever the threads do.
  std::optional<Failure> Expected() const {
    for (std::size_t i = 0; i < failing_.size(); ++i) {
      if (failing_[i] < 3) return Failure{i, failing_[i]};
    }
    return std::nullopt;
  }

  static constexpr int kItems = 12;
  std::size_t ended = 0;

 private:
  void FailIf(std::size_t i, int stage) const {
    if (failing_[i] == stage) throw Failure{i, stage};
  }
  void Solve() const {
    ParallelChunks(3, 1, [&](std::size_t chunk, std::size_t) {
      if (background_fails_ && chunk > 0)
        throw std::runtime_error("solve " + std::to_string(chunk));
    });
  }

  std::vector<std::unique_ptr<std::string>> slots_;
  std::vector<int> failing_;  // the stage at which an item fails; 3: at none
  bool background_fails_ = false;
  Background background_;
};

TEST(RunPipeline, ThrowsTheFirstFailureByItemWhateverStagesThrow) {
  Draws draws(4);
  for (int round = 0; round < 10000; ++round) {
    const ThreadLimit limit(static_cast<std::size_t>(round < 1000 ? 1 : draws.Integer(2, 4)));
    const auto most = static_cast<std::size_t>(draws.Integer(1, 5));
    FailingStages stages(&draws, most);
    std::optional<FailingStages::Failure> thrown;
    try {
      RunPipeline(most, &stages);
    } catch (const FailingStages::Failure& failure) {
      thrown = failure;
    }
    ASSERT_EQ(thrown, stages.Expected()) << "round " << round;
    const std::size_t whole = thrown ? thrown->item : FailingStages::kItems;
    ASSERT_EQ(stages.ended, whole) << "items before the first failure end as if there were none";
  }
}

}  // namespace
}  // namespace lamina
