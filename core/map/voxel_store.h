// Where root voxels of the map go when they leave memory, and come back from.
//
// The map hands out each root voxel as a record of bytes, which it alone understands
// (core/map/voxel_trees.cc). A store keeps records by *tile*, a cube of 4 x 4 x 4 root voxels, for
// what lies together returns together.
#pragma once

#include <cstddef>
#include <functional>
#include <string_view>

#include "core/map/voxel_key.h"

namespace lamina {

// Not thread-safe. Members throw OutputError or InputError when the medium fails. A record that
// comes back damaged is left out and counted: what it held is lost, the rest is not.
class VoxelStore {
 public:
  using Visit = std::function<void(std::string_view record)>;

  virtual ~VoxelStore() = default;
  VoxelStore() = default;
  VoxelStore(const VoxelStore&) = delete;
  VoxelStore& operator=(const VoxelStore&) = delete;

  // Whether a tile has any record, cheap enough to ask for each voxel of a scan.
  virtual bool Has(VoxelKey tile) const = 0;
  virtual bool Empty() const = 0;
  // Calls visit for each tile that has a record, in any order.
  virtual void ForEachTile(const std::function<void(VoxelKey tile)>& visit) const = 0;
  // A root has one record at most.
  virtual void Put(VoxelKey tile, VoxelKey root, std::string_view record) = 0;
  // Takes out all records of a tile, in the order of their roots' keys.
  virtual void Take(VoxelKey tile, const Visit& visit) = 0;
  // Takes out the record of one root, if there is one.
  virtual void TakeRoot(VoxelKey tile, VoxelKey root, const Visit& visit) = 0;
  // Shows all records (of a tile) and leaves them where they are; tiles and roots in the order of
  // their keys.
  virtual void Show(VoxelKey tile, const Visit& visit) const = 0;
  virtual void ShowAll(const Visit& visit) const = 0;
  virtual std::size_t records() const = 0;
};

}  // namespace lamina
