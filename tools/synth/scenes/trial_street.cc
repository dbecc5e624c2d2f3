#include "tools/synth/scenes/trial_street.h"

#include <cmath>
#include <functional>

#include "tools/synth/engine/random.h"
#include "tools/synth/scenes/block_models.h"
#include "tools/synth/scenes/objects.h"

namespace lamina::synth {
namespace {

using Eigen::Vector3f;

constexpr float kSeamOverlap = 0.01F;  // no gap for rays at the seams of blocks
constexpr auto kTrialStreetMiddle = static_cast<float>(kTrialMiddle);

// A row of blocks of so many metres along x; `fill` gets the block's number, and a builder in a
// frame on the middle of the way.
using FillPiece = std::function<void(std::int64_t block, const ShapeBuilder& at)>;

std::unique_ptr<SceneModel> MakeWay(float block_m, const FillPiece& fill,
                                    RowOfBlocks::Extent extent = RowOfBlocks::Extent::kEndless) {
  return std::make_unique<RowOfBlocks>(
      Eigen::Vector2d(block_m, 2.0 * kTrialMiddle), extent,
      [fill](std::int64_t block, std::vector<Primitive>* out) {
        fill(block, ShapeBuilder(out, {0.0F, kTrialStreetMiddle, 0.0F}, 0.0F));
      });
}

// The strip between two lines along x, given as (y, z).
void AddStrip(const ShapeBuilder& at, float length, const Eigen::Vector2f& from,
              const Eigen::Vector2f& to, Material material) {
  at.Quad({-kSeamOverlap, from.x(), from.y()}, {length + 2.0F * kSeamOverlap, 0.0F, 0.0F},
          {0.0F, to.x() - from.x(), to.y() - from.y()}, material);
}

void AddGround(const ShapeBuilder& at, float length, float half_width) {
  AddStrip(at, length, {-half_width, 0.0F}, {half_width, 0.0F}, Material::kAsphalt);
}

// A facade of bays; side -1 is on the right.
struct Facade {
  int side;
  float y;  // of bays that do not stand out, from the middle of the way
  float bay_m;
  double stands_out_most_m;
  float height_m;
};

void AddFacade(std::int64_t seed, std::int64_t block, float length, const Facade& facade,
               const ShapeBuilder& at) {
  const auto y_of = [&](std::int64_t bay) {
    const double out =
        facade.stands_out_most_m * UniformFrom(HashOf({seed, 0xba1, facade.side, bay}));
    return static_cast<float>(facade.side) * (facade.y - static_cast<float>(out));
  };
  const Vector3f up(0.0F, 0.0F, facade.height_m);
  const auto bays = static_cast<int>(std::lround(length / facade.bay_m));
  for (int i = 0; i < bays; ++i) {
    const std::int64_t bay = block * bays + i;
    const float x = facade.bay_m * static_cast<float>(i);
    const float before = y_of(bay - 1);
    const float here = y_of(bay);
    at.Quad({x, here, 0.0F}, {facade.bay_m, 0.0F, 0.0F}, up, Material::kPlaster);
    at.Quad({x, before, 0.0F}, {0.0F, here - before, 0.0F}, up, Material::kPlaster);
  }
}

void AddForestTree(const ShapeBuilder& at, HashStream* random) {
  const float radius = Draw(random, 0.1, 0.28);
  const float height = Draw(random, 6.0, 10.0);
  at.Tube({0.0F, 0.0F, 0.0F}, {Draw(random, -0.4, 0.4), Draw(random, -0.4, 0.4), height}, radius,
          Material::kWood);
  for (int i = 0; i < 30; ++i) {
    at.Spheroid({Draw(random, -1.4, 1.4), Draw(random, -1.4, 1.4), Draw(random, 3.0, 8.0)},
                Draw(random, 0.12, 0.35), Draw(random, 0.1, 0.25), Material::kFoliage);
  }
}

void FillForest(std::int64_t seed, std::int64_t block, const ShapeBuilder& at) {
  constexpr float kLength = 20.0F, kHalfWidth = 60.0F, kClear = 1.8F, kReach = 1.8F;
  AddGround(at, kLength, kHalfWidth);
  HashStream random(HashOf({seed, 0xf0, block}));
  for (int i = 0; i < 80; ++i) {
    const float x = Draw(&random, kReach, kLength - kReach);
    const float y = Draw(&random, kReach - kHalfWidth, kHalfWidth - kReach);
    if (std::abs(y) > kClear) AddForestTree(at.At({x, y, 0.0F}), &random);
  }
  for (int i = 0; i < 60; ++i) {  // undergrowth
    const float y = Draw(&random, -20.0, 20.0);
    if (std::abs(y) < kClear) continue;
    at.Spheroid({Draw(&random, 0.5, kLength - 0.5), y, 0.1F}, Draw(&random, 0.1, 0.4),
                Draw(&random, 0.1, 0.5), Material::kGrass);
  }
}

void FillCarPark(std::int64_t seed, std::int64_t block, const ShapeBuilder& at) {
  constexpr float kLength = 30.0F, kPlace = 3.0F;
  AddGround(at, kLength, 25.0F);
  HashStream random(HashOf({seed, 0xca4, block}));
  for (const float y : {-13.0F, 13.0F}) {
    for (float x = 0.5F * kPlace; x < kLength; x += kPlace) {
      if (!random.Chance(0.6)) continue;
      AddCar(at.At({x, y + Draw(&random, -0.3, 0.3), 0.0F}, kQuarterTurn), &random);
    }
  }
  for (const int side : {-1, 1})
    AddFacade(seed, block, kLength, {side, 20.0F, 6.0F, 0.5, 4.0F}, at);
}

void FillGlassCorridor(std::int64_t seed, std::int64_t block, const ShapeBuilder& at) {
  constexpr float kLength = 12.0F, kHalfWidth = 1.5F, kHeight = 2.8F, kBack = 6.5F;
  constexpr float kRight = -kHalfWidth, kLeft = kHalfWidth;
  const Vector3f up(0.0F, 0.0F, kHeight);
  AddStrip(at, kLength, {kRight - 0.2F, 0.0F}, {kBack, 0.0F}, Material::kPavement);
  AddStrip(at, kLength, {kRight - 0.2F, kHeight}, {kBack, kHeight}, Material::kPlaster);
  AddStrip(at, kLength, {kBack, 0.0F}, {kBack, kHeight}, Material::kPlaster);
  AddStrip(at, kLength, {kLeft, 0.0F}, {kLeft, kHeight}, Material::kPane);
  HashStream random(HashOf({seed, 0x61, block}));
  for (float x = 0.0F; x < kLength; x += 2.0F) {  // mullions
    at.Box({x + 0.1F, kLeft - 0.04F, 0.0F}, {x + 0.16F, kLeft + 0.04F, kHeight}, Material::kMetal);
  }
  for (const float x : {1.0F, 7.0F}) {  // rooms
    at.Box({x, kLeft + 0.05F, 0.0F}, {x + 0.1F, kBack, kHeight}, Material::kPlaster);
    for (int i = 0; i < 3; ++i) {
      const float left = Draw(&random, 0.2, 3.5);
      const float deep = Draw(&random, 1.0, 3.5);
      at.Box({x + left, kLeft + deep, 0.0F},
             {x + left + Draw(&random, 0.4, 1.2), kLeft + deep + Draw(&random, 0.4, 1.2),
              Draw(&random, 0.6, 2.0)},
             Material::kWood);
    }
  }
  constexpr float kDoor = 1.0F, kRecess = 0.15F;  // a door in every 4 m of the wall
  for (float x = 0.0F; x < kLength; x += 4.0F) {
    const float door = x + Draw(&random, 0.5, 2.5);
    at.Quad({x, kRight, 0.0F}, {door - x, 0.0F, 0.0F}, up, Material::kPlaster);
    at.Quad({door + kDoor, kRight, 0.0F}, {x + 4.0F - door - kDoor, 0.0F, 0.0F}, up,
            Material::kPlaster);
    at.Quad({door, kRight - kRecess, 0.0F}, {kDoor, 0.0F, 0.0F}, up, Material::kWood);
    for (const float side : {door, door + kDoor}) {
      at.Quad({side, kRight, 0.0F}, {0.0F, -kRecess, 0.0F}, up, Material::kPlaster);
    }
  }
}

void FillLift(const ShapeBuilder& at) {
  constexpr float kHalf = 0.75F, kHeight = 2.2F;
  constexpr auto kFront = static_cast<float>(kLiftFront);
  const ShapeBuilder cabin = at.At({2.0F, 0.0F, 0.0F});
  const Vector3f along(2.0F * kFront, 0.0F, 0.0F);
  const Vector3f across(0.0F, 2.0F * kHalf, 0.0F);
  const Vector3f up(0.0F, 0.0F, kHeight);
  cabin.Quad({-kFront, -kHalf, 0.0F}, along, across, Material::kPavement);
  cabin.Quad({-kFront, -kHalf, kHeight}, along, across, Material::kMetal);
  cabin.Quad({-kFront, -kHalf, 0.0F}, across, up, Material::kMetal);
  cabin.Quad({-kFront, -kHalf, 0.0F}, along, up, Material::kMetal);
  cabin.Quad({-kFront, kHalf, 0.0F}, along, up, Material::kMetal);
  cabin.Box({-0.5F, -kHalf, 0.9F}, {0.5F, 0.08F - kHalf, 0.96F}, Material::kMetal);  // handrail
  cabin.Box({kFront - 0.3F, kHalf - 0.03F, 0.8F}, {kFront - 0.1F, kHalf, 1.5F}, Material::kMetal);
}

}  // namespace

std::unique_ptr<SceneModel> MakeBays(std::int64_t seed) {
  constexpr float kLength = 40.0F, kFromMiddle = 8.0F;
  return MakeWay(kLength, [seed](std::int64_t block, const ShapeBuilder& at) {
    AddGround(at, kLength, kFromMiddle);
    for (const int side : {-1, 1}) {
      AddFacade(seed, block, kLength, {side, kFromMiddle, 5.0F, 1.5, 9.0F}, at);
    }
  });
}

std::unique_ptr<SceneModel> MakeField() {
  constexpr float kLength = 100.0F;
  return MakeWay(kLength, [](std::int64_t, const ShapeBuilder& at) {
    AddGround(at, kLength, kTrialStreetMiddle);
  });
}

std::unique_ptr<SceneModel> MakeTunnel() {
  constexpr float kLength = 50.0F;
  return MakeWay(kLength, [](std::int64_t, const ShapeBuilder& at) {
    // Half of the profile, (y, z); the other half is its mirror image.
    const Eigen::Vector2f profile[] = {{0.0F, 0.0F}, {5.0F, 0.0F}, {5.0F, 3.0F},
                                       {4.0F, 4.6F}, {2.2F, 5.7F}, {0.0F, 6.1F}};
    for (const float side : {-1.0F, 1.0F}) {
      for (int i = 0; i + 1 < 6; ++i) {
        const Eigen::Vector2f mirrored(side, 1.0F);
        AddStrip(at, kLength, profile[i].cwiseProduct(mirrored),
                 profile[i + 1].cwiseProduct(mirrored), Material::kConcrete);
      }
    }
  });
}

std::unique_ptr<SceneModel> MakeForest(std::int64_t seed) {
  return MakeWay(
      20.0F, [seed](std::int64_t block, const ShapeBuilder& at) { FillForest(seed, block, at); });
}

std::unique_ptr<SceneModel> MakeCarPark(std::int64_t seed) {
  return MakeWay(
      30.0F, [seed](std::int64_t block, const ShapeBuilder& at) { FillCarPark(seed, block, at); });
}

std::unique_ptr<SceneModel> MakePavement(std::int64_t seed) {
  constexpr float kLength = 30.0F;
  return MakeWay(kLength, [seed](std::int64_t block, const ShapeBuilder& at) {
    AddGround(at, kLength, 12.0F);
    AddFacade(seed, block, kLength, {-1, 2.5F, 3.0F, 0.4, 5.0F}, at);
    AddFacade(seed, block, kLength, {1, 12.0F, 5.0F, 1.0, 8.0F}, at);
  });
}

std::unique_ptr<SceneModel> MakeGlassCorridor(std::int64_t seed) {
  return MakeWay(12.0F, [seed](std::int64_t block, const ShapeBuilder& at) {
    FillGlassCorridor(seed, block, at);
  });
}

std::unique_ptr<SceneModel> MakeLift() {
  return MakeWay(
      4.0F, [](std::int64_t, const ShapeBuilder& at) { FillLift(at); }, RowOfBlocks::Extent::kOne);
}

}  // namespace lamina::synth
