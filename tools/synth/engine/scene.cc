#include "tools/synth/engine/scene.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace lamina::synth {
namespace {

// A key that is unique for indices of 31 bits, i.e. for any place on Earth.
std::uint64_t KeyOf(const BlockIndex& index) {
  return (static_cast<std::uint64_t>(index.x) << 32) ^
         (static_cast<std::uint64_t>(index.y) & 0xffffffffU);
}

std::int64_t FloorToInt(double x) { return static_cast<std::int64_t>(std::floor(x)); }

// Visits the cells of a grid under a ray, in order.
class GridWalk {
 public:
  GridWalk(const Eigen::Vector2d& origin, const Eigen::Vector2d& direction,
           const Eigen::Vector2d& cell) {
    for (std::size_t axis = 0; axis < 2; ++axis) {
      const auto row = static_cast<Eigen::Index>(axis);
      const double o = origin[row] / cell[row];
      const double d = direction[row] / cell[row];
      index_[axis] = FloorToInt(o);
      step_[axis] = d < 0.0 ? -1 : 1;
      const double inverse = 1.0 / std::max(std::abs(d), 1e-12);
      const double ahead = d < 0.0 ? o - std::floor(o) : std::floor(o) + 1.0 - o;
      next_[axis] = ahead * inverse;
      delta_[axis] = inverse;
    }
  }
  std::int64_t x() const { return index_[0]; }
  std::int64_t y() const { return index_[1]; }
  // Range at which the ray leaves the current cell.
  double leave() const { return std::min(next_[0], next_[1]); }
  void Advance() {
    const std::size_t axis = next_[0] < next_[1] ? 0 : 1;
    index_[axis] += step_[axis];
    next_[axis] += delta_[axis];
  }

 private:
  std::array<std::int64_t, 2> index_, step_;
  std::array<double, 2> next_, delta_;
};

// The first hit within one block; ranges in [enter, leave] are over its ground.
bool CastInBlock(const Block& block, const Ray& ray, float enter, float leave, float max_range,
                 SceneHit* hit) {
  float range = max_range;
  GroundHit on_ground;
  if (block.ground) {
    on_ground = block.ground->Cast(ray, enter, std::min(leave, max_range));
    range = std::min(range, on_ground.range);
  }
  if (const Primitive* primitive = block.tree.ClosestHit(ray, &range)) {
    *hit = {range, NormalAt(*primitive, ray.At(range)), primitive->material};
    return true;
  }
  if (on_ground.range >= kNoHit) return false;
  *hit = {on_ground.range, on_ground.normal, on_ground.material};
  return true;
}

}  // namespace

const std::vector<std::string>& SceneNames() {
  static const std::vector<std::string> names = {
      "street", "room",   "corridor", "stairs",  "hall",     "city",  "bays", "lorry",
      "field",  "tunnel", "forest",   "carpark", "pavement", "glass", "lift"};
  return names;
}

const Block* SceneView::At(std::int64_t x, std::int64_t y) const {
  const std::int64_t column = x - first_.x;
  const std::int64_t row = y - first_.y;
  if (column < 0 || row < 0 || column >= columns_ || row >= rows_) return nullptr;
  return blocks_[static_cast<std::size_t>(row * columns_ + column)].get();
}

Eigen::Vector3d SceneView::CornerOf(std::int64_t x, std::int64_t y) const {
  return {static_cast<double>(x) * block_size_.x(), static_cast<double>(y) * block_size_.y(), 0.0};
}

std::optional<SceneHit> SceneView::Cast(const Eigen::Vector3d& origin,
                                        const Eigen::Vector3d& direction,
                                        double max_range_m) const {
  GridWalk walk(origin.head<2>(), direction.head<2>(), block_size_);
  const auto max_range = static_cast<float>(max_range_m);
  double enter = 0.0;
  while (enter < max_range_m) {
    const double leave = walk.leave();
    if (const Block* block = At(walk.x(), walk.y())) {
      const Ray ray{(origin - CornerOf(walk.x(), walk.y())).cast<float>(), direction.cast<float>()};
      SceneHit hit;
      if (CastInBlock(*block, ray, static_cast<float>(enter), static_cast<float>(leave), max_range,
                      &hit)) {
        return hit;
      }
    }
    enter = leave;
    walk.Advance();
  }
  return std::nullopt;
}

double SceneView::SurfaceDistance(const Eigen::Vector3d& point, double bound_m) const {
  const std::int64_t x = FloorToInt(point.x() / block_size_.x());
  const std::int64_t y = FloorToInt(point.y() / block_size_.y());
  auto best = static_cast<float>(bound_m);
  for (std::int64_t dy = -1; dy <= 1; ++dy) {
    for (std::int64_t dx = -1; dx <= 1; ++dx) {
      const Block* block = At(x + dx, y + dy);
      if (!block) continue;
      const Eigen::Vector3f local = (point - CornerOf(x + dx, y + dy)).cast<float>();
      best = block->tree.Distance(local, best);
      if (dx == 0 && dy == 0 && block->ground) {
        best = std::min(best, block->ground->Distance(local));
      }
    }
  }
  return best;
}

SyntheticScene::SyntheticScene(std::unique_ptr<SceneModel> model, std::size_t max_blocks)
    : model_(std::move(model)), max_blocks_(max_blocks) {}

std::shared_ptr<SyntheticScene::Slot> SyntheticScene::SlotAt(const BlockIndex& index) const {
  const std::uint64_t key = KeyOf(index);
  const std::lock_guard<std::mutex> lock(mutex_);
  if (const auto found = slots_.find(key); found != slots_.end()) {
    recent_.splice(recent_.begin(), recent_, found->second->place);
    return found->second;
  }
  auto slot = std::make_shared<Slot>();
  recent_.push_front(key);
  slot->place = recent_.begin();
  slots_.emplace(key, slot);
  while (slots_.size() > max_blocks_) {
    slots_.erase(recent_.back());
    recent_.pop_back();
  }
  return slot;
}

std::shared_ptr<const Block> SyntheticScene::BlockAt(const BlockIndex& index) const {
  const std::shared_ptr<Slot> slot = SlotAt(index);
  std::call_once(slot->once, [&] { slot->block = model_->MakeBlock(index); });
  return slot->block;
}

SceneView SyntheticScene::ViewAround(const Eigen::Vector3d& position, double radius_m) const {
  SceneView view;
  view.block_size_ = model_->BlockSize();
  view.first_ = {FloorToInt((position.x() - radius_m) / view.block_size_.x()),
                 FloorToInt((position.y() - radius_m) / view.block_size_.y())};
  view.columns_ = FloorToInt((position.x() + radius_m) / view.block_size_.x()) - view.first_.x + 1;
  view.rows_ = FloorToInt((position.y() + radius_m) / view.block_size_.y()) - view.first_.y + 1;
  view.blocks_.reserve(static_cast<std::size_t>(view.columns_ * view.rows_));
  for (std::int64_t row = 0; row < view.rows_; ++row) {
    for (std::int64_t column = 0; column < view.columns_; ++column) {
      view.blocks_.push_back(BlockAt({view.first_.x + column, view.first_.y + row}));
    }
  }
  return view;
}

std::size_t SyntheticScene::cached_blocks() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return slots_.size();
}

}  // namespace lamina::synth
