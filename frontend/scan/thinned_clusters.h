// A part of a scan's clusters, for what some of them tell as well as all.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace lamina {

// Every n-th one, with the smallest n that leaves `most` of them at most; most >= 1. As they come,
// clusters are those of points that were measured one after the other: the part covers the scan.
template <typename Cluster>
std::vector<Cluster> Thinned(const std::vector<Cluster>& clusters, std::size_t most) {
  const std::size_t step = std::max<std::size_t>(1, (clusters.size() + most - 1) / most);
  std::vector<Cluster> some;
  some.reserve(clusters.size() / step + 1);
  for (std::size_t i = 0; i < clusters.size(); i += step) some.push_back(clusters[i]);
  return some;
}

}  // namespace lamina
