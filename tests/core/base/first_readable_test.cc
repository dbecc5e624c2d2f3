#include "core/base/first_readable.h"

#include <gtest/gtest.h>

namespace lamina {
namespace {

TEST(FirstReadable, TriesSomeAndNoMore) {
  std::size_t readable = 3, reads = 0;
  const auto read = [&](std::size_t i) {
    ++reads;
    if (i < readable) throw InputError("damaged");
    return i;
  };
  EXPECT_EQ(FirstReadable(0, 100, read), 3U);
  EXPECT_EQ(FirstReadable(2, 100, read), 3U);
  EXPECT_EQ(FirstReadable(0, 3, read), std::nullopt);
  EXPECT_EQ(FirstReadable(5, 5, read), std::nullopt);
  readable = kReadTries;
  reads = 0;
  EXPECT_EQ(FirstReadable(0, 100, read), std::nullopt);
  EXPECT_EQ(reads, kReadTries);
}

}  // namespace
}  // namespace lamina
