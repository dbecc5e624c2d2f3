#include "tools/export/thinning.h"

#include <algorithm>
#include <cmath>

#include "core/base/median.h"

namespace lamina {
namespace {

constexpr std::size_t kFewestSlots = 64;

std::int64_t IndexOf(VoxelKey key, std::size_t axis) {
  const auto shift = (2 - static_cast<int>(axis)) * kVoxelKeyBits;
  return static_cast<std::int64_t>((key >> shift) & ((VoxelKey{1} << kVoxelKeyBits) - 1));
}

// Where to cut the keys: an axis and an index with keys on both sides.
struct Cut {
  std::size_t axis = 0;
  std::int64_t index = 0;
};

Cut CutInHalf(const VoxelSet& set) {
  std::array<std::int64_t, 3> low, high;
  low.fill(std::int64_t{1} << kVoxelKeyBits);
  high.fill(0);
  set.ForEach([&](VoxelKey key) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      low[axis] = std::min(low[axis], IndexOf(key, axis));
      high[axis] = std::max(high[axis], IndexOf(key, axis));
    }
  });
  Cut cut;
  for (std::size_t axis = 1; axis < 3; ++axis) {
    if (high[axis] - low[axis] > high[cut.axis] - low[cut.axis]) cut.axis = axis;
  }
  std::vector<std::int32_t> indices;
  indices.reserve(set.size());
  set.ForEach(
      [&](VoxelKey key) { indices.push_back(static_cast<std::int32_t>(IndexOf(key, cut.axis))); });
  // Above the lowest: otherwise a crowd in one layer would leave the kept half empty.
  cut.index = std::max<std::int64_t>(UpperMedian(&indices), low[cut.axis] + 1);
  return cut;
}

}  // namespace

VoxelSet::VoxelSet(std::size_t budget_bytes)
    : max_slots_(kFewestSlots), slots_(kFewestSlots, kEmpty) {
  // Filter holds two tables of the full size, the most that this class ever does.
  while (2 * (2 * max_slots_) * sizeof(VoxelKey) <= budget_bytes) max_slots_ *= 2;
}

VoxelSet::Result VoxelSet::Insert(VoxelKey key) {
  const std::size_t mask = slots_.size() - 1;
  std::size_t i = HashVoxelKey(key) & mask;
  for (; slots_[i] != kEmpty; i = (i + 1) & mask) {
    if (slots_[i] == key) return Result::kPresent;
  }
  if (4 * (size_ + 1) <= 3 * slots_.size()) {
    slots_[i] = key;
    ++size_;
    return Result::kInserted;
  }
  if (slots_.size() == max_slots_) return Result::kFull;
  std::vector<VoxelKey> old(2 * slots_.size(), kEmpty);
  old.swap(slots_);
  size_ = 0;
  for (const VoxelKey slot : old) {
    if (slot != kEmpty) Insert(slot);
  }
  return Insert(key);
}

bool VoxelBox::Contains(VoxelKey key) const {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::int64_t index = IndexOf(key, axis);
    if (index < low[axis] || index >= high[axis]) return false;
  }
  return true;
}

bool VoxelBox::MeetsBall(const Eigen::Vector3d& centre, double radius_m,
                         double voxel_size_m) const {
  double distance2 = 0.0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const double c = centre(static_cast<Eigen::Index>(axis));
    const double from = voxel_size_m * static_cast<double>(low[axis] - kVoxelKeyOffset);
    const double to = voxel_size_m * static_cast<double>(high[axis] - kVoxelKeyOffset);
    const double outside = std::max({from - c, c - to, 0.0});
    distance2 += outside * outside;
  }
  return distance2 <= radius_m * radius_m;
}

bool PassThinner::BeginPass() {
  if (put_off_.empty()) return false;
  current_ = put_off_.back();
  put_off_.pop_back();
  set_ = VoxelSet(budget_bytes_);
  ++passes_;
  return true;
}

bool PassThinner::Keep(VoxelKey key, const Place& place) {
  if (!current_.box.Contains(key)) return false;
  VoxelSet::Result result = set_.Insert(key);
  while (result == VoxelSet::Result::kFull) {
    Split(place);
    if (!current_.box.Contains(key)) return false;
    result = set_.Insert(key);
  }
  if (result == VoxelSet::Result::kPresent || place < current_.keep_from) return false;
  ++kept_;
  return true;
}

void PassThinner::Split(const Place& place) {
  const Cut cut = CutInHalf(set_);
  // What the other half kept up to here is written; its own pass must not write that again.
  Work other{current_.box, std::max(place, current_.keep_from)};
  other.box.low[cut.axis] = cut.index;
  current_.box.high[cut.axis] = cut.index;
  put_off_.push_back(other);
  set_.Filter([&](VoxelKey key) { return IndexOf(key, cut.axis) < cut.index; });
}

}  // namespace lamina
