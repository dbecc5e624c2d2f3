// Parallel loops whose result does not depend on the number of threads.
//
// Work is cut into chunks of a FIXED size, whatever the machine; each chunk is done by one thread,
// and partial results are joined in the order of the chunks. Floating-point sums therefore come out
// the same, bit for bit, at 1, 2 or 16 threads. Built on TBB; nested calls are fine.
#pragma once

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cstddef>
#include <vector>

namespace lamina {

// Calls body(begin, end) for consecutive chunks of [0, size). Chunks must not write to one another.
template <typename Body>
void ParallelChunks(size_t size, size_t chunk, const Body& body) {
  const size_t chunks = (size + chunk - 1) / chunk;
  if (chunks <= 1) {
    if (size > 0) body(size_t{0}, size);
    return;
  }
  // Isolated: a thread that waits for the last chunk must not start a long task from elsewhere.
  tbb::this_task_arena::isolate([&] {
    tbb::parallel_for(tbb::blocked_range<size_t>(0, chunks, 1), [&](const auto& range) {
      for (size_t c = range.begin(); c != range.end(); ++c) {
        body(c * chunk, std::min(size, (c + 1) * chunk));
      }
    });
  });
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

}  // namespace lamina
