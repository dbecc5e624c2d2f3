// A store of root voxels that keeps them in memory.
#pragma once

#include <map>
#include <string>
#include <utility>

#include "core/map/voxel_store.h"

namespace lamina {

class MemoryVoxelStore final : public VoxelStore {
 public:
  bool Has(VoxelKey tile) const override { return tiles_.count(tile) > 0; }
  bool Empty() const override { return tiles_.empty(); }
  void ForEachTile(const std::function<void(VoxelKey tile)>& visit) const override {
    for (const auto& [tile, records] : tiles_) visit(tile);
  }
  void Put(VoxelKey tile, VoxelKey root, std::string_view record) override {
    tiles_[tile][root] = record;
  }
  void Take(VoxelKey tile, const Visit& visit) override {
    const auto records = std::move(tiles_[tile]);
    tiles_.erase(tile);
    for (const auto& [root, record] : records) visit(record);
  }
  void TakeRoot(VoxelKey tile, VoxelKey root, const Visit& visit) override {
    const auto found = tiles_.find(tile);
    if (found == tiles_.end() || found->second.count(root) == 0) return;
    const std::string record = std::move(found->second.at(root));
    found->second.erase(root);
    if (found->second.empty()) tiles_.erase(found);
    visit(record);
  }
  void Show(VoxelKey tile, const Visit& visit) const override {
    for (const auto& [root, record] : tiles_.at(tile)) visit(record);
  }
  void ShowAll(const Visit& visit) const override {
    for (const auto& [tile, records] : tiles_) Show(tile, visit);
  }
  std::size_t records() const override {
    std::size_t count = 0;
    for (const auto& [tile, records] : tiles_) count += records.size();
    return count;
  }

 private:
  std::map<VoxelKey, std::map<VoxelKey, std::string>> tiles_;
};

}  // namespace lamina
