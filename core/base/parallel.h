// Work on several threads whose result does not depend on their number.
//
// Loops are cut into chunks of a FIXED size, whatever the machine; each chunk is done by one
// thread, and partial results are joined in the order of the chunks. Floating-point sums therefore
// come out the same, bit for bit, at 1, 2 or 16 threads. Built on TBB, which no other file needs to
// see; nested calls are fine.
//
// What a call throws is thrown again to the caller when all calls have ended. If several throw, it
// is the exception of the first chunk or item, in their order: what a failure looks like does not
// depend on the number of threads either. No exception passes through TBB.
#pragma once

#include <algorithm>
#include <cstddef>
#include <functional>
#include <memory>
#include <vector>

namespace lamina {

namespace internal {

// Calls run(context, i) once for each i in [0, count), on any threads.
void RunParallel(size_t count, void (*run)(const void* context, size_t i), const void* context);

}  // namespace internal

// Calls body(begin, end) for consecutive chunks of [0, size). Chunks must not write to one another.
template <typename Body>
void ParallelChunks(size_t size, size_t chunk, const Body& body) {
  const auto run = [&](size_t c) { body(c * chunk, std::min(size, (c + 1) * chunk)); };
  using Run = decltype(run);
  const size_t chunks = (size + chunk - 1) / chunk;
  if (chunks == 1) run(0);
  if (chunks <= 1) return;
  internal::RunParallel(
      chunks, [](const void* context, size_t c) { (*static_cast<Run*>(context))(c); }, &run);
}

// sum = body(chunk 0) + body(chunk 1) + ..., in this order; body(begin, end) returns a Sum, and
// Sum needs operator+=. `zero` is the neutral element.
template <typename Sum, typename Body>
Sum ParallelSum(size_t size, size_t chunk, const Sum& zero, const Body& body) {
  const size_t chunks = (size + chunk - 1) / chunk;
  std::vector<Sum> partial(chunks, zero);
  ParallelChunks(size, chunk,
                 [&](size_t begin, size_t end) { partial[begin / chunk] = body(begin, end); });
  Sum sum = zero;
  for (const Sum& p : partial) sum += p;
  return sum;
}

// One piece of work beside the caller's own. Not thread-safe.
class Background {
 public:
  Background();
  ~Background();  // waits; what the work threw is dropped

  // What was started before must have been waited for.
  void Start(std::function<void()> work);
  // Until it is done; throws what it threw. The waiting thread does it, or other work, itself.
  void Wait();

 private:
  struct Group;
  std::unique_ptr<Group> group_;
};

// Items 0, 1, 2, ... go through three stages, several of them at once.
class PipelineStages {
 public:
  virtual ~PipelineStages() = default;
  // Whether there is an item i. One call at a time, in the order of the items; false ends them.
  virtual bool Begin(size_t i) = 0;
  // Calls for several items at once, in any order.
  virtual void Work(size_t i) = 0;
  // One call at a time, in the order of the items.
  virtual void End(size_t i) = 0;
};

// At most `most` items are between Begin and End: item i begins when item i - most has ended. When
// a call throws for item i, the items before it are still taken to their End, no new ones begin,
// and End is called neither for item i nor for any item after it.
void RunPipeline(size_t most, PipelineStages* stages);

}  // namespace lamina
