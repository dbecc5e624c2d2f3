#include "backend/loops/anchor_correction.h"

#include <algorithm>
#include <numeric>
#include <utility>

namespace lamina {

StampNs MiddleNs(const Submap& submap) {
  return submap.keyframes[submap.keyframes.size() / 2].stamp_ns;
}

AnchorCorrection::AnchorCorrection(const std::vector<Submap>& submaps,
                                   const std::vector<SE3>& anchors,
                                   const std::vector<TrimmedSubmap>& trimmed) {
  for (std::size_t i = 0; i < submaps.size(); ++i)
    Add(MiddleNs(submaps[i]), anchors[i] * submaps[i].T_world_submap.Inverse());
  for (const TrimmedSubmap& submap : trimmed) {
    Add(submap.middle_ns,
        anchors[submap.holder] * submap.T_holder_submap * submap.T_world_submap.Inverse());
  }
  if (!trimmed.empty()) SortByStamp();
}

AnchorCorrection::AnchorCorrection(const std::vector<const Submap*>& submaps,
                                   const std::vector<SE3>& from, const std::vector<SE3>& to,
                                   const std::vector<TrimmedSubmap>& trimmed) {
  for (std::size_t i = 0; i < submaps.size(); ++i)
    Add(MiddleNs(*submaps[i]), to[i] * from[i].Inverse());
  for (const TrimmedSubmap& submap : trimmed)
    Add(submap.middle_ns, to[submap.holder] * from[submap.holder].Inverse());
  if (!trimmed.empty()) SortByStamp();
}

AnchorCorrection::AnchorCorrection(std::vector<StampNs> stamps, const std::vector<SE3>& from,
                                   const std::vector<SE3>& to)
    : middles_(std::move(stamps)) {
  for (std::size_t i = 0; i < from.size(); ++i) corrections_.push_back(to[i] * from[i].Inverse());
}

void AnchorCorrection::Add(StampNs middle_ns, const SE3& T_corrected_world) {
  middles_.push_back(middle_ns);
  corrections_.push_back(T_corrected_world);
}

void AnchorCorrection::SortByStamp() {
  std::vector<std::size_t> order(middles_.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t i, std::size_t j) { return middles_[i] < middles_[j]; });
  const AnchorCorrection unsorted = std::exchange(*this, {});
  for (const std::size_t i : order) Add(unsorted.middles_[i], unsorted.corrections_[i]);
}

SE3 AnchorCorrection::Corrected(StampNs stamp_ns, const SE3& T_world_lidar) const {
  if (middles_.empty()) return T_world_lidar;
  const auto after = static_cast<std::size_t>(
      std::lower_bound(middles_.begin(), middles_.end(), stamp_ns) - middles_.begin());
  if (after == 0) return corrections_.front() * T_world_lidar;
  if (after == middles_.size()) return corrections_.back() * T_world_lidar;
  const double share = static_cast<double>(stamp_ns - middles_[after - 1]) /
                       static_cast<double>(middles_[after] - middles_[after - 1]);
  return Interpolate(corrections_[after - 1] * T_world_lidar, corrections_[after] * T_world_lidar,
                     share);
}

}  // namespace lamina
