// Every n-th of many things, for what some of them tell as well as all: a part that covers all of a
// scan, whose points stand in the order in which they were measured.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace lamina {

// The smallest n >= 1 that leaves `most` >= 1 at most.
inline std::size_t StrideToAtMost(std::size_t count, std::size_t most) {
  return std::max<std::size_t>(1, (count + most - 1) / most);
}

// The greatest n >= 1 that leaves `least` >= 1 at least, or all: fewer than twice as many.
inline std::size_t StrideToAtLeast(std::size_t count, std::size_t least) {
  return std::max<std::size_t>(1, count / least);
}

// At most so many.
template <typename T>
std::vector<T> Thinned(const std::vector<T>& all, std::size_t most) {
  const std::size_t stride = StrideToAtMost(all.size(), most);
  std::vector<T> some;
  some.reserve(all.size() / stride + 1);
  for (std::size_t i = 0; i < all.size(); i += stride) some.push_back(all[i]);
  return some;
}

}  // namespace lamina
