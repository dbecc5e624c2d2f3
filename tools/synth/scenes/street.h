// A town of rectangular blocks: streets along every edge of a block, within them a raised parcel
// with pavements, houses, gardens, trees, street furniture and parked cars.
//
// A city has blocks of other kinds among these: parks, squares around one large house, and
// terraces, whose houses are all the same, from one block to the next, too: what repeats is taken
// for another place. What is parked differs from one drive to the next.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>

#include "tools/synth/engine/scene.h"
#include "tools/synth/scenes/ground.h"

namespace lamina::synth {

inline constexpr int kStreetBlockX = 96, kStreetBlockY = 64;  // metres
inline constexpr float kRoadHalfWidth = 5.5F;                 // from the middle line to the curb
inline constexpr float kCurbHeight = 0.12F;
inline constexpr double kLaneOffset = 1.7;      // from the middle line to that of the right lane
inline constexpr double kPavementOffset = 6.6;  // to where people walk

class StreetModel final : public SceneModel {
 public:
  explicit StreetModel(std::int64_t seed) : seed_(seed), terrain_(seed) {}
  // A city, on a day of this number.
  StreetModel(std::int64_t seed, int day) : seed_(seed), city_(true), day_(day), terrain_(seed) {}
  Eigen::Vector2d BlockSize() const override { return {kStreetBlockX, kStreetBlockY}; }
  std::unique_ptr<const Block> MakeBlock(const BlockIndex& index) const override;
  const Terrain& terrain() const { return terrain_; }

 private:
  std::int64_t seed_;
  bool city_ = false;
  int day_ = 0;
  Terrain terrain_;
};

}  // namespace lamina::synth
