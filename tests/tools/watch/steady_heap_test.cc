// Large blocks of the program come in few sizes.
#include "tools/watch/steady_heap.h"

#include <gtest/gtest.h>
#include <malloc.h>

#include <cstdint>
#include <limits>
#include <set>
#include <vector>

namespace lamina {
namespace {

TEST(SteadyHeap, LargeBlocksHaveFourSizesForEachPowerOfTwo) {
  std::set<std::size_t> sizes;
  for (std::size_t bytes = (1 << 20) + 1; bytes <= (2 << 20); bytes += 997) {
    const std::size_t rounded = RoundedBlock(bytes);
    EXPECT_GE(rounded, bytes);
    EXPECT_LE(rounded, bytes + bytes / 4);
    EXPECT_EQ(RoundedBlock(rounded), rounded);
    sizes.insert(rounded);
  }
  EXPECT_EQ(sizes.size(), 4U);
}

TEST(SteadyHeap, SmallAndImpossibleBlocksStayAsTheyAre) {
  EXPECT_EQ(RoundedBlock(0), 0U);
  EXPECT_EQ(RoundedBlock(1000), 1000U);
  const std::size_t most = std::numeric_limits<std::size_t>::max();
  EXPECT_EQ(RoundedBlock(most), most);
}

#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
TEST(SteadyHeap, ContainersGetThem) {
  KeepHeapSteady();
  std::vector<std::uint8_t> bytes(700001);
  EXPECT_GE(malloc_usable_size(bytes.data()), RoundedBlock(700001));
}
#endif

}  // namespace
}  // namespace lamina
