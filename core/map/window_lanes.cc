#include "core/map/window_lanes.h"

#include <cstring>

#include "core/base/processor.h"
#include "core/geometry/cluster_lanes.h"
#include "core/map/root_key.h"

namespace lamina {
namespace {

using FourKeys = VoxelKey __attribute__((vector_size(32)));

// RootCentre of four keys.
[[gnu::always_inline]] inline void RootCentres(const VoxelKey* keys, double size, Four* centre) {
  // A double of this size has integers alone, the last bits of which are its own.
  constexpr double kInteger = 4503599627370496.0;              // 2^52
  constexpr VoxelKey kBitsOfInteger = VoxelKey{0x4330} << 48;  // of that
  const FourKeys of = {keys[0], keys[1], keys[2], keys[3]};
#pragma GCC unroll 3
  for (int axis = 0; axis < 3; ++axis) {
    const FourKeys index = (of >> RootKeyLayout::kShift[axis]) & RootKeyLayout::Mask(axis);
    const Four offset_index = reinterpret_cast<Four>(index | kBitsOfInteger) - kInteger;
    centre[axis] = size * (offset_index - static_cast<double>(RootKeyLayout::kOffset[axis]) + 0.5);
  }
}

[[gnu::always_inline]] inline void AddTo(double* sums, const Four& added) {
  Four four;
  std::memcpy(&four, sums, sizeof(four));
  four += added;
  std::memcpy(sums, &four, sizeof(four));
}

// Adds ClusterMoments::Of to four windows. `keys`: of their roots.
LAMINA_FOR_EACH_PROCESSOR
void AddFour(const PointCluster* const* clusters, const VoxelKey* keys, double root_size_m,
             ClusterMoments* const* windows) {
  ClusterLanes c;
  c.Load(NumbersOf(*clusters[0]), NumbersOf(*clusters[1]), NumbersOf(*clusters[2]),
         NumbersOf(*clusters[3]));
  Four centre[3], offset[3], first[3];
  RootCentres(keys, root_size_m, centre);
#pragma GCC unroll 3
  for (int i = 0; i < 3; ++i) {
    offset[i] = c.mean[i] - centre[i];
    first[i] = c.count * offset[i];
  }
  const Four* const s = c.scatter;
  Four head[4] = {c.count, first[0], first[1], first[2]};
  Four middle[4] = {s[0] + first[0] * offset[0], s[1] + first[0] * offset[1],
                    s[2] + first[0] * offset[2], s[3] + first[1] * offset[1]};
  const Four yz = s[4] + first[1] * offset[2], zz = s[5] + first[2] * offset[2];
  Transpose(head);
  Transpose(middle);
#pragma GCC unroll 4
  for (int k = 0; k < 4; ++k) {
    double* const sums = &windows[k]->count;
    AddTo(sums, head[k]);
    AddTo(sums + 4, middle[k]);
    sums[8] += yz[k];
    sums[9] += zz[k];
  }
}

// ClusterMoments::Exchange in four windows, one after the other: they may be of one leaf. `keys`:
// of their roots.
LAMINA_FOR_EACH_PROCESSOR
void ExchangeFour(const PointCluster* const* before, const PointCluster* const* after,
                  const VoxelKey* keys, double root_size_m, ClusterMoments* const* windows) {
  ClusterLanes a, b;
  a.Load(NumbersOf(*after[0]), NumbersOf(*after[1]), NumbersOf(*after[2]), NumbersOf(*after[3]));
  b.Load(NumbersOf(*before[0]), NumbersOf(*before[1]), NumbersOf(*before[2]),
         NumbersOf(*before[3]));
  Four centre[3], change[3], m[3];
  RootCentres(keys, root_size_m, centre);
#pragma GCC unroll 3
  for (int i = 0; i < 3; ++i) {
    change[i] = b.count * (a.mean[i] - b.mean[i]);
    m[i] = 0.5 * (a.mean[i] + b.mean[i]) - centre[i];
  }
  const Four *const s = a.scatter, *const r = b.scatter;
  Four head[4] = {change[0], change[1], change[2], s[0] - r[0] + 2.0 * change[0] * m[0]};
  Four middle[4] = {s[1] - r[1] + change[0] * m[1] + change[1] * m[0],
                    s[2] - r[2] + change[0] * m[2] + change[2] * m[0],
                    s[3] - r[3] + 2.0 * change[1] * m[1],
                    s[4] - r[4] + change[1] * m[2] + change[2] * m[1]};
  const Four last = s[5] - r[5] + 2.0 * change[2] * m[2];
  Transpose(head);
  Transpose(middle);
#pragma GCC unroll 4
  for (int k = 0; k < 4; ++k) {
    double* const sums = &windows[k]->count;
    AddTo(sums + 1, head[k]);
    AddTo(sums + 5, middle[k]);
    sums[9] += last[k];
  }
}

}  // namespace

void FourWindows::Add() {
  if (full()) {
    AddFour(clusters_, roots_, root_size_m_, windows_);
  } else {
    for (std::size_t k = 0; k < count_; ++k)
      *windows_[k] += ClusterMoments::Of(*clusters_[k], RootCentre(roots_[k], root_size_m_));
  }
  count_ = 0;
}

void FourWindows::Exchange() {
  if (full()) {
    ExchangeFour(clusters_, after_, roots_, root_size_m_, windows_);
  } else {
    for (std::size_t k = 0; k < count_; ++k)
      windows_[k]->Exchange(*clusters_[k], *after_[k], RootCentre(roots_[k], root_size_m_));
  }
  count_ = 0;
}

}  // namespace lamina
