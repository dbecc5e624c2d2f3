#include "core/map/voxel_key.h"

#include <algorithm>

namespace lamina {

void VoxelIndex::Rehash(std::size_t expected_size) {
  std::size_t capacity = 64;
  while (capacity < 2 * expected_size) capacity *= 2;
  std::vector<Slot> old(capacity);
  old.swap(slots_);
  mask_ = capacity - 1;
  size_ = 0;
  for (const Slot& slot : old) {
    if (slot.value != kNone) FindOrInsert(slot.key, slot.value);
  }
}

void VoxelIndex::Clear() {
  std::fill(slots_.begin(), slots_.end(), Slot());
  size_ = 0;
}

void VoxelIndex::Erase(VoxelKey key) {
  std::size_t i = HashVoxelKey(key) & mask_;
  while (slots_[i].value != kNone && slots_[i].key != key) i = (i + 1) & mask_;
  if (slots_[i].value == kNone) return;
  --size_;
  // Close the gap: a later entry of the same run moves up unless its home lies behind the gap.
  for (std::size_t j = (i + 1) & mask_; slots_[j].value != kNone; j = (j + 1) & mask_) {
    const std::size_t home = HashVoxelKey(slots_[j].key) & mask_;
    if (((j - home) & mask_) >= ((j - i) & mask_)) {
      slots_[i] = slots_[j];
      i = j;
    }
  }
  slots_[i].value = kNone;
}

}  // namespace lamina
