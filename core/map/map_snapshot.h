// The map as it stood at one moment, saved part by part while it goes on changing.
//
// Roots are saved in the order of their last touch; one that is about to change before its turn
// comes is saved first. Roots that are made after the moment are not part of it.
#pragma once

#include <cstdint>
#include <string>

#include "core/geometry/state_archive.h"
#include "core/map/voxel_trees.h"

namespace lamina {

// Not thread-safe.
class MapSnapshot {
 public:
  // A snapshot under way is given up.
  void Begin(const VoxelTrees& trees);
  // Saves roots until `bytes` have come together, and moves them to *records. False when the
  // snapshot is complete.
  bool Continue(std::size_t bytes, VoxelTrees* trees, std::string* records);

  // Before anything of a root changes that the snapshot would show.
  void BeforeChange(NodeId root, VoxelTrees* trees) {
    if (under_way_ && trees->root(root).snapshot != number_) Save(root, trees);
  }
  // Before a root leaves its place in the order of touches.
  void BeforeMove(NodeId root, const VoxelTrees& trees) {
    if (next_ == root) next_ = trees.newer(root);
  }
  // What a root that is made now has for MapRoot::snapshot.
  std::uint32_t number() const { return number_; }

 private:
  void Save(NodeId root, VoxelTrees* trees);

  bool under_way_ = false;
  std::uint32_t number_ = 0;
  NodeId next_ = kNoNode;  // in the order of touches
  StateArchive records_;
};

}  // namespace lamina
