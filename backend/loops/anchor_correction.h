// Poses move with the anchors of the submaps that they belong to.
#pragma once

#include <cstddef>
#include <vector>

#include "backend/submaps/submap.h"
#include "core/geometry/se3.h"
#include "core/geometry/state_archive.h"

namespace lamina {

// The stamp of the keyframe in the middle of a submap.
StampNs MiddleNs(const Submap& submap);

// What is left of a submap that the map does without (submap_trimming.h): what the poses of its
// keyframes are corrected by. It moves with another submap of its piece, its holder.
struct TrimmedSubmap {
  std::size_t holder = 0;  // position among the submaps of the piece
  StampNs middle_ns = 0;   // of its keyframes
  SE3 T_world_submap;      // as odometry has it
  SE3 T_holder_submap;

  void Archive(StateArchive& a) { a(&holder, &middle_ns, &T_world_submap, &T_holder_submap); }
};

// Between the middles of two submaps the correction is the geodesic between both of theirs, so that
// the trajectory has no steps. Thread-safe once it is made.
class AnchorCorrection {
 public:
  AnchorCorrection() = default;  // moves nothing
  // From odometry to these anchors. `trimmed`: in the order of their stamps.
  AnchorCorrection(const std::vector<Submap>& submaps, const std::vector<SE3>& anchors,
                   const std::vector<TrimmedSubmap>& trimmed = {});
  // From these anchors to those.
  AnchorCorrection(const std::vector<const Submap*>& submaps, const std::vector<SE3>& from,
                   const std::vector<SE3>& to, const std::vector<TrimmedSubmap>& trimmed = {});
  // From these poses at these stamps, ascending, to those.
  AnchorCorrection(std::vector<StampNs> stamps, const std::vector<SE3>& from,
                   const std::vector<SE3>& to);
  SE3 Corrected(StampNs stamp_ns, const SE3& T_world_lidar) const;

  void Archive(StateArchive& a) { a(&middles_, &corrections_); }

 private:
  void Add(StampNs middle_ns, const SE3& T_corrected_world);
  void SortByStamp();

  std::vector<StampNs> middles_;
  std::vector<SE3> corrections_;  // T_corrected_world
};

}  // namespace lamina
