// Thinning a stream of points to one per voxel, in bounded memory.
//
// Of each cubic voxel of the world the first point that comes is kept. Which voxels are taken is
// held in a hash set of at most `budget_bytes`. A map with more voxels is done in several passes
// over the stream: when the set is full, the box being worked on is cut in two along its longest
// side, at the median of the voxels taken; the pass goes on with one half, and the other half is
// put off, together with the place in the stream where that happened. A later pass takes up the
// half again from the start of the stream, but keeps no point from before that place: those it
// has kept already. So the result is that of a single pass with unlimited memory, in another order.
//
// The boxes let the caller skip what cannot lie in the one being worked on.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

#include "core/map/voxel_key.h"

namespace lamina {

// A set of voxel keys in 8 bytes a slot, which refuses to grow beyond its budget.
class VoxelSet {
 public:
  // Growing holds the old table beside the new one; the budget counts both.
  explicit VoxelSet(std::size_t budget_bytes);

  enum class Result { kInserted, kPresent, kFull };
  Result Insert(VoxelKey key);
  std::size_t size() const { return size_; }
  std::size_t bytes() const { return slots_.capacity() * sizeof(VoxelKey); }

  template <typename Visitor>
  void ForEach(const Visitor& visit) const {
    for (const VoxelKey slot : slots_) {
      if (slot != kEmpty) visit(slot);
    }
  }
  // Keeps the keys for which keep(key) holds.
  template <typename Predicate>
  void Filter(const Predicate& keep) {
    std::vector<VoxelKey> old(slots_.size(), kEmpty);
    old.swap(slots_);
    size_ = 0;
    for (const VoxelKey slot : old) {
      if (slot != kEmpty && keep(slot)) Insert(slot);
    }
  }

 private:
  // Not the key of any voxel: keys have 63 bits.
  static constexpr VoxelKey kEmpty = ~VoxelKey{0};

  std::size_t max_slots_;
  std::size_t size_ = 0;
  std::vector<VoxelKey> slots_;
};

// A box of voxels: low(axis) <= index < high(axis), indices counted from the corner of the grid as
// they stand in a key.
struct VoxelBox {
  std::array<std::int64_t, 3> low{0, 0, 0};
  std::array<std::int64_t, 3> high{1 << kVoxelKeyBits, 1 << kVoxelKeyBits, 1 << kVoxelKeyBits};

  bool Contains(VoxelKey key) const;
  // Whether a ball (metres, world frame) reaches into the box, for voxels of `voxel_size_m`.
  bool MeetsBall(const Eigen::Vector3d& centre, double radius_m, double voxel_size_m) const;
};

// Use: for every pass (while BeginPass() is true), offer all points of the stream in the same
// order; a point is to be written when Keep returns true. Single-threaded.
class PassThinner {
 public:
  // Place of a point in the stream; grows from one point to the next.
  using Place = std::pair<std::size_t, std::size_t>;

  explicit PassThinner(std::size_t budget_bytes) : budget_bytes_(budget_bytes), set_(0) {}

  // Starts the next pass; false when every box is done.
  bool BeginPass();
  bool Keep(VoxelKey key, const Place& place);

  // The box that this pass works on. It only shrinks during a pass.
  const VoxelBox& box() const { return current_.box; }
  int passes() const { return passes_; }
  std::size_t kept() const { return kept_; }

 private:
  struct Work {
    VoxelBox box;
    Place keep_from{0, 0};
  };
  // Cuts the current box, puts off the half with the larger indices.
  void Split(const Place& place);

  std::size_t budget_bytes_;
  VoxelSet set_;
  Work current_;
  std::vector<Work> put_off_{Work{}};
  int passes_ = 0;
  std::size_t kept_ = 0;
};

}  // namespace lamina
