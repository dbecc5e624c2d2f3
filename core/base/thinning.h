// A part of a scan's clusters, for what some of them tell as well as all.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace lamina {

// Every n-th one, with the smallest n that leaves `most` of them at most; most >= 1. They stand in
// the order in which they were measured, so the part covers all of the scan.
template <typename Cluster>
std::vector<Cluster> Thinned(const std::vector<Cluster>& all, std::size_t most) {
  const std::size_t step = std::max<std::size_t>(1, (all.size() + most - 1) / most);
  std::vector<Cluster> some;
  some.reserve(all.size() / step + 1);
  for (std::size_t i = 0; i < all.size(); i += step) some.push_back(all[i]);
  return some;
}

}  // namespace lamina
