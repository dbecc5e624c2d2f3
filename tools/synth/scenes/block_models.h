// Two plain kinds of scenes: one block, and a row of blocks along x.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <memory>
#include <utility>
#include <vector>

#include "tools/synth/engine/scene.h"

namespace lamina::synth {

// Fills blocks (i, 0) for all i, or for i = 0 alone; the others are empty.
class RowOfBlocks final : public SceneModel {
 public:
  // Adds what stands in block i, in coordinates relative to the block's corner.
  using Fill = std::function<void(std::int64_t i, std::vector<Primitive>* out)>;
  enum class Extent { kOne, kEndless };

  RowOfBlocks(const Eigen::Vector2d& block_size_m, Extent extent, Fill fill)
      : size_(block_size_m), extent_(extent), fill_(std::move(fill)) {}

  Eigen::Vector2d BlockSize() const override { return size_; }

  std::unique_ptr<const Block> MakeBlock(const BlockIndex& index) const override {
    if (index.y != 0 || (extent_ == Extent::kOne && index.x != 0)) return nullptr;
    std::vector<Primitive> primitives;
    fill_(index.x, &primitives);
    auto block = std::make_unique<Block>();
    block->tree = PrimitiveTree(std::move(primitives));
    return block;
  }

 private:
  Eigen::Vector2d size_;
  Extent extent_;
  Fill fill_;
};

}  // namespace lamina::synth
