#include "core/base/worker_thread.h"

#include <gtest/gtest.h>

#include <atomic>
#include <memory>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

namespace lamina {
namespace {

constexpr std::size_t kMany = 100000;

void NoFailure(const std::exception& error) { ADD_FAILURE() << error.what(); }

TEST(WorkerThread, DoesItsWorkInOrderOnOneOtherThread) {
  std::vector<int> order;
  std::vector<std::thread::id> threads;
  WorkerThread worker(NoFailure, kMany);
  for (int i = 0; i < 1000; ++i) {
    worker.Do([&, i] {
      order.push_back(i);
      threads.push_back(std::this_thread::get_id());
    });
  }
  worker.Wait();
  ASSERT_EQ(order.size(), 1000U);
  for (int i = 0; i < 1000; ++i) EXPECT_EQ(order[static_cast<std::size_t>(i)], i);
  for (const std::thread::id id : threads) EXPECT_EQ(id, threads.front());
  EXPECT_NE(threads.front(), std::this_thread::get_id());
}

TEST(WorkerThread, EndsWithItsWorkDone) {
  int done = 0;
  {
    WorkerThread worker(NoFailure, kMany);
    for (int i = 0; i < 100; ++i) worker.Do([&] { ++done; });
  }
  EXPECT_EQ(done, 100);
}

TEST(WorkerThread, WaitsForNothingIfThereIsNothing) {
  WorkerThread worker(NoFailure, kMany);
  worker.Wait();
  worker.Wait();
}

TEST(WorkerThread, TellsWhatFailedAndGoesOn) {
  std::vector<std::string> failures;
  int done = 0;
  WorkerThread worker([&](const std::exception& error) { failures.push_back(error.what()); },
                      kMany);
  worker.Do([&] { ++done; });
  worker.Do([] { throw std::runtime_error("no disk"); });
  worker.Do([&] { ++done; });
  worker.Wait();
  EXPECT_EQ(done, 2);
  EXPECT_EQ(failures, std::vector<std::string>{"no disk"});
}

// Wait() waits for what was handed over before it, not for what the work hands over itself.
TEST(WorkerThread, WorkMayHandOverWork) {
  int done = 0;
  WorkerThread worker(NoFailure, kMany);
  worker.Do([&] { worker.Do([&] { ++done; }); });
  worker.Wait();
  worker.Wait();
  EXPECT_EQ(done, 1);
}

// What work holds may call its worker when it goes.
TEST(WorkerThread, WorkIsGivenBackOutsideOfTheLock) {
  int done = 0;
  bool gone = false;
  WorkerThread worker(NoFailure, kMany);
  std::shared_ptr<int> held(new int(0), [&](const int* p) {
    worker.Do([&] { ++done; });
    delete p;
    gone = true;
  });
  worker.Do([held] { ++*held; });
  held.reset();
  worker.Wait();
  EXPECT_TRUE(gone) << "it counts as under way until it is gone";
  worker.Wait();
  EXPECT_EQ(done, 1);
}

TEST(WorkerThread, TakesWorkFromManyThreads) {
  std::atomic<int> done{0};
  WorkerThread worker(NoFailure, kMany);
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t) {
    threads.emplace_back([&] {
      for (int i = 0; i < 500; ++i) worker.Do([&] { ++done; });
      worker.Wait();
      EXPECT_GE(done, 500);
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(done, 2000);
}

}  // namespace
}  // namespace lamina
