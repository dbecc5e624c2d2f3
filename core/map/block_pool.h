// Objects of one type in blocks, named by numbers that stay theirs until they are given back.
//
// Blocks are big enough that their table stays small, small enough that a budget of a megabyte is
// some dozen of them. They are filled again, never given back: memory is that of the most objects
// that there were at once.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <vector>

namespace lamina {

// Thread-safety: different objects may be used at once; New and Free need the pool for themselves.
template <typename T>
class BlockPool {
 public:
  static constexpr int kBlockBits = 8;
  static constexpr std::int32_t kBlockSize = 1 << kBlockBits;

  T& operator[](std::int32_t i) {
    return blocks_[static_cast<std::size_t>(i >> kBlockBits)][i & (kBlockSize - 1)];
  }
  const T& operator[](std::int32_t i) const {
    return blocks_[static_cast<std::size_t>(i >> kBlockBits)][i & (kBlockSize - 1)];
  }

  // The number of a new object, as T() makes it.
  std::int32_t New() {
    ++used_;
    most_used_ = std::max(most_used_, used_);
    const std::int32_t i = free_;
    if (i == kNone) {
      if ((next_ & (kBlockSize - 1)) == 0) blocks_.push_back(std::make_unique<T[]>(kBlockSize));
      return next_++;
    }
    std::memcpy(&free_, static_cast<const void*>(&(*this)[i]), sizeof(free_));
    (*this)[i] = T();
    return i;
  }
  void Free(std::int32_t i) {
    // The list of free objects is chained through their first bytes.
    std::memcpy(static_cast<void*>(&(*this)[i]), &free_, sizeof(free_));
    free_ = i;
    --used_;
  }

  std::size_t used() const { return used_; }
  // The most that there were at once. A pool that continues another's work takes over its figure.
  std::size_t most_used() const { return most_used_; }
  void ContinueFrom(std::size_t most_used) { most_used_ = std::max(most_used_, most_used); }

  // Memory that the pool takes.
  std::size_t bytes() const {
    return blocks_.size() * kBlockSize * sizeof(T) + blocks_.capacity() * sizeof(blocks_[0]);
  }
  // What so many objects take.
  static constexpr double BytesOf(double objects) {
    return objects * (static_cast<double>(sizeof(T)) + sizeof(void*) / double{kBlockSize});
  }

 private:
  std::vector<std::unique_ptr<T[]>> blocks_;
  static constexpr std::int32_t kNone = -1;
  static_assert(sizeof(T) >= sizeof(std::int32_t));

  std::int32_t next_ = 0;
  std::int32_t free_ = kNone;
  std::size_t used_ = 0, most_used_ = 0;
};

}  // namespace lamina
