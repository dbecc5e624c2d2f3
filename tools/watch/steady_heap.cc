#include "tools/watch/steady_heap.h"

#ifdef __GLIBC__
#include <malloc.h>
#endif

#include <cstdlib>
#include <limits>
#include <new>

namespace lamina {

std::size_t RoundedBlock(std::size_t bytes) {
  constexpr std::size_t kLarge = 32 << 10;
  if (bytes < kLarge || bytes > std::numeric_limits<std::size_t>::max() / 2) return bytes;
  std::size_t power = kLarge;
  while (power <= bytes / 2) power *= 2;
  const std::size_t step = power / 4;
  return (bytes + step - 1) / step * step;
}

void KeepHeapSteady() {
#ifdef __GLIBC__
  constexpr int kLargeBytes = 4 << 20, kNeverTrimmedBytes = 1 << 30;
  mallopt(M_ARENA_MAX, 1);
  mallopt(M_MMAP_THRESHOLD, kLargeBytes);
  mallopt(M_TRIM_THRESHOLD, kNeverTrimmedBytes);
#endif
}

}  // namespace lamina

// Sanitizers have their own.
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)

void* operator new(std::size_t bytes) {
  const std::size_t size = lamina::RoundedBlock(bytes == 0 ? 1 : bytes);
  while (true) {
    if (void* block = std::malloc(size)) return block;
    const std::new_handler handler = std::get_new_handler();
    if (handler == nullptr) throw std::bad_alloc();
    handler();
  }
}

void operator delete(void* block) noexcept { std::free(block); }
void operator delete(void* block, std::size_t) noexcept { std::free(block); }

#endif
