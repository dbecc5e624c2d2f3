// Synthetic scenes with exact geometry, made up block by block as a ray or a sensor comes near.
//
// A scene is an endless chequerboard of rectangular blocks. What stands in a block is a function of
// the scene's seed and the block's indices, so a block may be forgotten and made again, and an
// endless drive costs a constant amount of memory. Nothing in a block reaches out of its rectangle;
// a ray therefore visits the blocks under it in order and stops at the first hit.
//
// Scene frame: z up, metres, double precision. Inside a block: single precision, relative to the
// block's corner.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <list>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

#include "tools/synth/engine/bvh.h"
#include "tools/synth/scenes/ground.h"

namespace lamina::synth {

enum class SceneKind {
  kStreet,
  kRoom,
  kCorridor,
  kStairs,
  kHall,
  kCity,
  // Those of tools/synth/scenes/trial_scenes.h:
  kBays,
  kLorry,
  kField,
  kTunnel,
  kForest,
  kCarPark,
  kPavement,
  kGlass,
  kLift,
};
// In the order of SceneKind.
const std::vector<std::string>& SceneNames();

struct BlockIndex {
  std::int64_t x = 0, y = 0;
};

struct Block {
  PrimitiveTree tree;
  std::optional<Ground> ground;
};

// What a kind of scene is made of. Implementations are immutable: thread-safe.
class SceneModel {
 public:
  virtual ~SceneModel() = default;
  // Extent of each block, metres. Block (0, 0) has its lower corner at the scene's origin.
  virtual Eigen::Vector2d BlockSize() const = 0;
  // A pure function of its argument; null where the scene is empty.
  virtual std::unique_ptr<const Block> MakeBlock(const BlockIndex& index) const = 0;
};

struct SceneHit {
  double range_m = 0.0;
  Eigen::Vector3f normal = Eigen::Vector3f::UnitZ();  // unit, of either sign
  Material material = Material::kConcrete;
};

// The blocks around a place, pinned in memory: rays are cast without locks. Thread-safe.
class SceneView {
 public:
  // First surface on the ray within max_range_m, if any; direction has unit length. The ray sees
  // the blocks of the view alone.
  std::optional<SceneHit> Cast(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction,
                               double max_range_m) const;

  // Distance from a point to the nearest surface, or bound_m where none is nearer. For points in or
  // beside the view's blocks; bound_m should not exceed a block's size.
  double SurfaceDistance(const Eigen::Vector3d& point, double bound_m) const;

 private:
  friend class SyntheticScene;
  const Block* At(std::int64_t x, std::int64_t y) const;
  Eigen::Vector3d CornerOf(std::int64_t x, std::int64_t y) const;

  Eigen::Vector2d block_size_ = Eigen::Vector2d::Ones();
  BlockIndex first_;
  std::int64_t columns_ = 0, rows_ = 0;
  std::vector<std::shared_ptr<const Block>> blocks_;
};

// A scene and its cache of blocks. Thread-safe.
class SyntheticScene {
 public:
  // At most `max_blocks` blocks are kept besides those that views hold.
  SyntheticScene(std::unique_ptr<SceneModel> model, std::size_t max_blocks);

  // All blocks that have a point within radius_m of the position, in plan.
  SceneView ViewAround(const Eigen::Vector3d& position, double radius_m) const;

  std::size_t cached_blocks() const;

 private:
  // Made by the thread that needs it first; the others wait.
  struct Slot {
    std::once_flag once;
    std::shared_ptr<const Block> block;
    std::list<std::uint64_t>::iterator place;  // in recent_
  };
  std::shared_ptr<const Block> BlockAt(const BlockIndex& index) const;
  std::shared_ptr<Slot> SlotAt(const BlockIndex& index) const;

  std::unique_ptr<SceneModel> model_;
  std::size_t max_blocks_;
  mutable std::mutex mutex_;
  mutable std::list<std::uint64_t> recent_;  // keys, most recently used first
  mutable std::unordered_map<std::uint64_t, std::shared_ptr<Slot>> slots_;
};

}  // namespace lamina::synth
