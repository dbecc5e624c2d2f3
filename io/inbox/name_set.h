// A set of names by their 64-bit hashes: 10 to 15 bytes a name, however long.
//
// Private to io/inbox.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <string_view>
#include <vector>

namespace lamina {

// Two names share a hash with probability n^2 / 2^65: 3e-8 among a million. Names never leave.
class NameSet {
 public:
  std::size_t size() const { return size_; }
  std::size_t bytes() const { return slots_.capacity() * sizeof(std::uint64_t); }

  bool Contains(std::string_view name) const { return slots_[SlotOf(Hash(name))] != kFree; }

  void Insert(std::string_view name) {
    // Filled to 4/5 at most; grown by a half, so that memory stays near what is used.
    if (5 * (size_ + 1) > 4 * slots_.size()) Grow();
    std::uint64_t& slot = slots_[SlotOf(Hash(name))];
    size_ += slot == kFree ? 1 : 0;
    slot = Hash(name);
  }

 private:
  static constexpr std::uint64_t kFree = 0;

  static std::uint64_t Hash(std::string_view name) {
    const std::uint64_t hash = std::hash<std::string_view>()(name);
    return hash == kFree ? 1 : hash;
  }
  // Where the hash is or would be.
  std::size_t SlotOf(std::uint64_t hash) const {
    __extension__ using Wide = unsigned __int128;
    std::size_t i = static_cast<std::size_t>((Wide{hash} * slots_.size()) >> 64);
    while (slots_[i] != kFree && slots_[i] != hash) i = i + 1 < slots_.size() ? i + 1 : 0;
    return i;
  }
  void Grow() {
    std::vector<std::uint64_t> old(slots_.size() + slots_.size() / 2, kFree);
    old.swap(slots_);
    for (const std::uint64_t hash : old) {
      if (hash != kFree) slots_[SlotOf(hash)] = hash;
    }
  }

  std::vector<std::uint64_t> slots_ = std::vector<std::uint64_t>(64, kFree);
  std::size_t size_ = 0;
};

}  // namespace lamina
