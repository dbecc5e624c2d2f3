// Indices of cubic voxels, packed and hashed.
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace lamina {

// Three signed indices of 21 bits each in one word: with voxels of 1 m, +-1048 km about the origin.
using VoxelKey = std::uint64_t;

inline constexpr int kVoxelKeyBits = 21;
inline constexpr std::int64_t kVoxelKeyOffset = std::int64_t{1} << (kVoxelKeyBits - 1);

// Indices must lie in [-2^20, 2^20); IsVoxelKeyInRange tells.
inline VoxelKey PackVoxelKey(std::int64_t x, std::int64_t y, std::int64_t z) {
  return (static_cast<VoxelKey>(x + kVoxelKeyOffset) << (2 * kVoxelKeyBits)) |
         (static_cast<VoxelKey>(y + kVoxelKeyOffset) << kVoxelKeyBits) |
         static_cast<VoxelKey>(z + kVoxelKeyOffset);
}

inline VoxelKey VoxelKeyOf(const Eigen::Vector3d& p, double inverse_size) {
  return PackVoxelKey(static_cast<std::int64_t>(std::floor(p.x() * inverse_size)),
                      static_cast<std::int64_t>(std::floor(p.y() * inverse_size)),
                      static_cast<std::int64_t>(std::floor(p.z() * inverse_size)));
}

inline bool IsVoxelKeyInRange(const Eigen::Vector3d& p, double inverse_size) {
  // False for NaN, too: every comparison with it is.
  return ((p * inverse_size).array().abs() < static_cast<double>(kVoxelKeyOffset - 1)).all();
}

inline Eigen::Vector3d VoxelCentre(VoxelKey key, double size) {
  constexpr VoxelKey kMask = (VoxelKey{1} << kVoxelKeyBits) - 1;
  const auto index = [&](int shift) {
    return static_cast<double>(static_cast<std::int64_t>((key >> shift) & kMask) - kVoxelKeyOffset);
  };
  return size * (Eigen::Vector3d(index(2 * kVoxelKeyBits), index(kVoxelKeyBits), index(0)) +
                 Eigen::Vector3d::Constant(0.5));
}

// Every bit of the key reaches every bit of the hash (the finaliser of splitmix64, Steele et al.
// 2014). Neighbouring voxels differ in few bits; a weaker mix lines them up in the table.
inline std::uint64_t HashVoxelKey(VoxelKey key) {
  key ^= key >> 30;
  key *= 0xbf58476d1ce4e5b9ULL;
  key ^= key >> 27;
  key *= 0x94d049bb133111ebULL;
  return key ^ (key >> 31);
}

// A flat hash table from voxel keys to indices: open addressing, linear probing, at most half full,
// deletion without tombstones. Not thread-safe for writing; any number of threads may call Find.
class VoxelIndex {
 public:
  static constexpr std::int32_t kNone = -1;

  explicit VoxelIndex(std::size_t expected_size = 0) { Rehash(expected_size); }

  std::size_t size() const { return size_; }
  std::size_t bytes() const { return slots_.capacity() * sizeof(Slot); }
  // What VoxelIndex(expected_size) needs to be as large as this one.
  std::size_t expected_size() const { return slots_.size() / 2; }

  std::int32_t Find(VoxelKey key) const {
    for (std::size_t i = HashVoxelKey(key) & mask_;; i = (i + 1) & mask_) {
      if (slots_[i].value == kNone || slots_[i].key == key) return slots_[i].value;
    }
  }

  // The value stored under key; if there is none, `value` is stored and returned.
  std::int32_t FindOrInsert(VoxelKey key, std::int32_t value) {
    if (2 * (size_ + 1) > slots_.size()) Rehash(size_ + 1);
    for (std::size_t i = HashVoxelKey(key) & mask_;; i = (i + 1) & mask_) {
      Slot& slot = slots_[i];
      if (slot.value != kNone && slot.key != key) continue;
      if (slot.value == kNone) {
        slot = {key, value};
        ++size_;
      }
      return slot.value;
    }
  }

  // Has the place of the key fetched to the processor: where many are looked up, ahead of time.
  void Prefetch(VoxelKey key) const { __builtin_prefetch(&slots_[HashVoxelKey(key) & mask_]); }

  // As a set: whether the key is new to it.
  bool Insert(VoxelKey key) {
    const std::size_t before = size_;
    FindOrInsert(key, 0);
    return size_ > before;
  }

  // Of values that are gathered by voxel, in the order in which the voxels came up: that of the
  // key, a new one if it has none yet.
  template <typename T>
  T& Gather(VoxelKey key, std::vector<T>* values) {
    const auto next = static_cast<std::int32_t>(values->size());
    const std::int32_t at = FindOrInsert(key, next);
    if (at == next) values->emplace_back();
    return (*values)[static_cast<std::size_t>(at)];
  }

  // Does nothing if the key is not there.
  void Erase(VoxelKey key);
  // Keeps its memory.
  void Clear();

 private:
  struct Slot {
    VoxelKey key = 0;
    std::int32_t value = kNone;
  };
  void Rehash(std::size_t expected_size);

  std::vector<Slot> slots_;
  std::size_t mask_ = 0;
  std::size_t size_ = 0;
};

}  // namespace lamina
