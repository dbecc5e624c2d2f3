#include "tools/synth/scenes/street.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "tools/synth/engine/random.h"
#include "tools/synth/scenes/objects.h"

namespace lamina::synth {
namespace {

using Eigen::Vector2f;
using Eigen::Vector3f;

// One of the four sides of a parcel. u runs along the curb, v from the curb into the parcel
// (v < 0: on the road), both in metres from the side's own corner.
class Frontage {
 public:
  Frontage(const Ground& ground, int side, std::vector<Primitive>* out)
      : ground_(ground), out_(out), yaw_(kQuarterTurn * static_cast<float>(side)) {
    const float right = kStreetBlockX - kRoadHalfWidth;
    const float top = kStreetBlockY - kRoadHalfWidth;
    const Vector2f corners[] = {{kRoadHalfWidth, kRoadHalfWidth},
                                {right, kRoadHalfWidth},
                                {right, top},
                                {kRoadHalfWidth, top}};
    corner_ = corners[side];
    along_ = (corners[(side + 1) % 4] - corner_).normalized();
    length_ = (corners[(side + 1) % 4] - corner_).norm();
  }

  float length() const { return length_; }

  // A builder standing on the ground at (u, v), its x along u but for an extra `yaw`.
  ShapeBuilder At(float u, float v, float yaw = 0.0F) const {
    const Vector2f inward(-along_.y(), along_.x());
    const Vector2f p = corner_ + u * along_ + v * inward;
    return ShapeBuilder(out_, {p.x(), p.y(), ground_.HeightAt(p.x(), p.y())}, yaw_ + yaw);
  }

 private:
  const Ground& ground_;
  std::vector<Primitive>* out_;
  float yaw_;
  Vector2f corner_, along_;
  float length_ = 0.0F;
};

// What separates a front garden from the pavement.
void AddBorder(const Frontage& side, float u, float length, float v, HashStream* random) {
  // In short pieces, which follow the ground.
  constexpr float kPiece = 6.0F;
  const int kind = random->Index(4);
  const int pieces = std::max(1, static_cast<int>(std::ceil(length / kPiece)));
  const float step = length / static_cast<float>(pieces);
  for (int i = 0; i < pieces; ++i) {
    const ShapeBuilder at = side.At(u + step * static_cast<float>(i), v);
    if (kind == 0) AddHedge(at, step, random);
    if (kind == 1) AddFence(at, step, random);
    if (kind == 2) AddGardenWall(at, step, random);
  }
}

// Houses on lots between u_begin and u_end, at most `deepest` metres from the curb.
void AddLots(const Frontage& side, float u_begin, float u_end, float deepest, HashStream* random) {
  float u = u_begin;
  while (u + 8.0F < u_end) {
    const float lot = std::min(u_end - u, Draw(random, 9.5, 17.0));
    const float setback = Draw(random, 3.2, 6.5);
    if (random->Chance(0.85)) {
      const float gap = random->Chance(0.5) ? 0.0F : Draw(random, 0.5, 3.5);
      const HouseSize size{lot - gap, std::min(Draw(random, 7.5, 10.5), deepest - setback),
                           1 + random->Index(3)};
      AddHouse(side.At(u, setback, Draw(random, -0.03, 0.03)), size, random);
    } else {
      AddTree(side.At(u + 0.5F * lot, setback + 3.0F), Draw(random, 1.5, 2.6), random);
    }
    if (setback > 4.2F) AddBorder(side, u, lot, 2.8F, random);
    u += lot;
  }
}

void AddStreetFurniture(const Frontage& side, HashStream* random) {
  for (float u = Draw(random, 6, 12); u < side.length() - 6.0F; u += Draw(random, 9, 16)) {
    if (random->Chance(0.55)) AddTree(side.At(u, 1.1F), Draw(random, 1.3, 2.2), random);
  }
  for (float u = Draw(random, 3, 20); u < side.length() - 3.0F; u += Draw(random, 22, 30)) {
    AddLamp(side.At(u, 0.5F), random);
  }
  for (float u = Draw(random, 2, 10); u < side.length() - 2.0F; u += Draw(random, 12, 40)) {
    AddSign(side.At(u, 0.6F, random->Chance(0.5) ? 0.0F : 2.0F * kQuarterTurn), random);
  }
  for (float u = Draw(random, 2, 10); u < side.length() - 2.0F; u += Draw(random, 8, 25)) {
    AddBin(side.At(u, 2.3F), random);
  }
}

void AddParkedCars(const Frontage& side, HashStream* random) {
  constexpr float kClearOfCrossing = 9.0F;
  for (float u = kClearOfCrossing; u < side.length() - kClearOfCrossing; u += 6.2F) {
    if (!random->Chance(0.45)) continue;
    const float turned =
        Draw(random, -0.03, 0.03) + (random->Chance(0.1) ? 0.0F : kQuarterTurn * 2);
    AddCar(side.At(u + Draw(random, -0.3, 0.3), -Draw(random, 1.05, 1.2), turned), random);
  }
}

// Trees and sheds behind the houses.
void AddGardens(const Ground& ground, std::vector<Primitive>* out, HashStream* random) {
  constexpr float kMiddle = 0.5F * kStreetBlockY;
  for (int i = 0; i < 9; ++i) {
    const float x = Draw(random, 0.25 * kStreetBlockX, 0.75 * kStreetBlockX);
    const float y = kMiddle + Draw(random, -7, 7);
    const ShapeBuilder at(out, {x, y, ground.HeightAt(x, y)}, Draw(random, 0, 3));
    if (random->Chance(0.75)) {
      AddTree(at, Draw(random, 1.5, 2.8), random);
    } else {
      at.Box({-1.5F, -1.2F, -0.5F}, {1.5F, 1.2F, 2.2F}, Material::kWood);
    }
  }
}

enum class BlockKind { kHouses, kTerrace, kPark, kSquare };

BlockKind KindOf(std::int64_t seed, const BlockIndex& index) {
  const double u = UniformFrom(HashOf({seed, 0xc17, index.x, index.y}));
  if (u < 0.55) return BlockKind::kHouses;
  if (u < 0.75) return BlockKind::kTerrace;
  return u < 0.88 ? BlockKind::kPark : BlockKind::kSquare;
}

// The same house on every lot.
void AddTerrace(const Frontage& side, float u_begin, float u_end) {
  constexpr float kWidth = 8.0F, kSetback = 4.0F, kDepth = 9.0F;
  for (float u = u_begin; u + kWidth <= u_end; u += kWidth) {
    HashStream house(0x7e44ace);
    AddHouse(side.At(u, kSetback), {kWidth, kDepth, 2}, &house);
  }
}

void AddPark(const Ground& ground, std::vector<Primitive>* out, HashStream* random) {
  for (int i = 0; i < 60; ++i) {
    const float x = Draw(random, kRoadHalfWidth + 4.0, kStreetBlockX - kRoadHalfWidth - 4.0);
    const float y = Draw(random, kRoadHalfWidth + 4.0, kStreetBlockY - kRoadHalfWidth - 4.0);
    AddTree(ShapeBuilder(out, {x, y, ground.HeightAt(x, y)}, Draw(random, 0, 3)),
            Draw(random, 1.5, 2.8), random);
  }
}

// A church or a market hall in the middle of an open place.
void AddSquare(const Ground& ground, std::vector<Primitive>* out, HashStream* random) {
  const float width = Draw(random, 18, 34), depth = Draw(random, 12, 18);
  const float x = 0.5F * kStreetBlockX - 0.5F * width + Draw(random, -12, 12);
  const float y = 0.5F * kStreetBlockY - 0.5F * depth + Draw(random, -6, 6);
  AddHouse(ShapeBuilder(out, {x, y, ground.HeightAt(x, y)}, Draw(random, -0.3, 0.3)),
           {width, depth, 3 + random->Index(2)}, random);
}

}  // namespace

std::unique_ptr<const Block> StreetModel::MakeBlock(const BlockIndex& index) const {
  const Eigen::Vector2d corner(static_cast<double>(index.x) * kStreetBlockX,
                               static_cast<double>(index.y) * kStreetBlockY);
  auto block = std::make_unique<Block>();
  block->ground.emplace(terrain_, corner, Eigen::Vector2i(kStreetBlockX, kStreetBlockY),
                        kRoadHalfWidth, kCurbHeight);
  HashStream random(HashOf({seed_, 0xb10c, index.x, index.y}));
  HashStream parked(HashOf({seed_, 0xca4, day_, index.x, index.y}));
  const BlockKind kind = city_ ? KindOf(seed_, index) : BlockKind::kHouses;
  std::vector<Primitive> primitives;
  for (int side = 0; side < 4; ++side) {
    const Frontage frontage(*block->ground, side, &primitives);
    // The long sides own the corners of the parcel, the short ones what is between.
    const bool is_long = side % 2 == 0;
    const float margin = is_long ? 4.0F : 18.0F;
    if (kind == BlockKind::kHouses)
      AddLots(frontage, margin, frontage.length() - margin, is_long ? 16.0F : 14.0F, &random);
    if (kind == BlockKind::kTerrace) AddTerrace(frontage, margin, frontage.length() - margin);
    AddStreetFurniture(frontage, &random);
    AddParkedCars(frontage, city_ ? &parked : &random);
  }
  if (kind == BlockKind::kHouses) AddGardens(*block->ground, &primitives, &random);
  if (kind == BlockKind::kPark) AddPark(*block->ground, &primitives, &random);
  if (kind == BlockKind::kSquare) AddSquare(*block->ground, &primitives, &random);
  block->tree = PrimitiveTree(std::move(primitives));
  return block;
}

}  // namespace lamina::synth
