// Things numbered from 0, and which of them are joined: each set goes by its smallest number.
#pragma once

#include <algorithm>
#include <cstddef>
#include <numeric>
#include <vector>

namespace lamina {

class DisjointSets {
 public:
  // Each alone.
  explicit DisjointSets(std::size_t count) : parent_(count) {
    std::iota(parent_.begin(), parent_.end(), std::size_t{0});
  }

  // The smallest of those that it is joined with.
  std::size_t Find(std::size_t i) {
    while (parent_[i] != i) {
      parent_[i] = parent_[parent_[i]];
      i = parent_[i];
    }
    return i;
  }
  void Join(std::size_t a, std::size_t b) {
    a = Find(a);
    b = Find(b);
    parent_[std::max(a, b)] = std::min(a, b);
  }
  // Find() of each.
  std::vector<std::size_t> All() {
    std::vector<std::size_t> all(parent_.size());
    for (std::size_t i = 0; i < all.size(); ++i) all[i] = Find(i);
    return all;
  }

 private:
  std::vector<std::size_t> parent_;  // never greater than the child
};

}  // namespace lamina
