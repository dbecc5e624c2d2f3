#include "tools/watch/steady_heap.h"

#ifdef __GLIBC__
#include <malloc.h>
#endif

namespace lamina {

void KeepHeapSteady() {
#ifdef __GLIBC__
  constexpr int kLargeBytes = 4 << 20, kNeverTrimmedBytes = 1 << 30;
  mallopt(M_ARENA_MAX, 1);
  mallopt(M_MMAP_THRESHOLD, kLargeBytes);
  mallopt(M_TRIM_THRESHOLD, kNeverTrimmedBytes);
#endif
}

}  // namespace lamina
