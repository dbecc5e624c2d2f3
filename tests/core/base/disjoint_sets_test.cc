#include "core/base/disjoint_sets.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace lamina {
namespace {

using testing::ElementsAre;

TEST(DisjointSets, EachSetGoesByItsSmallestNumber) {
  DisjointSets sets(7);
  EXPECT_THAT(sets.All(), ElementsAre(0, 1, 2, 3, 4, 5, 6));
  sets.Join(5, 3);
  sets.Join(6, 5);
  EXPECT_THAT(sets.All(), ElementsAre(0, 1, 2, 3, 4, 3, 3));
  sets.Join(6, 1);
  sets.Join(2, 4);
  sets.Join(3, 5);  // are joined
  EXPECT_THAT(sets.All(), ElementsAre(0, 1, 2, 1, 2, 1, 1));
}

TEST(DisjointSets, ALongChainIsOneSet) {
  constexpr std::size_t kCount = 200000;
  DisjointSets sets(kCount);
  for (std::size_t i = kCount; i-- > 1;) sets.Join(i, i - 1);
  EXPECT_EQ(sets.Find(kCount - 1), 0U);
  EXPECT_EQ(sets.Find(kCount / 2), 0U);
}

}  // namespace
}  // namespace lamina
