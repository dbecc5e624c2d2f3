#include "tools/synth/scenes/objects.h"

#include <algorithm>
#include <cmath>

namespace lamina::synth {
namespace {

using Eigen::Vector3f;

constexpr float kFoundation = 0.6F;  // below the ground, where it slopes
constexpr float kStoreyHeight = 2.9F;
constexpr float kWindowRecess = 0.18F;  // depth of windows behind the facade
constexpr float kSill = 0.9F, kLintel = 2.25F;

// One storey of the facade: sills, piers and a lintel band in front of the core, glass in between.
void AddFacadeStorey(const ShapeBuilder& at, float width, int windows, int door, Material wall) {
  const float cell = width / static_cast<float>(windows);
  const float opening = std::min(1.5F, 0.55F * cell);
  at.Box({0.0F, 0.0F, kLintel}, {width, kWindowRecess, kStoreyHeight}, wall);
  for (int i = 0; i <= windows; ++i) {
    const float middle = static_cast<float>(i) * cell;
    const float half = 0.5F * (cell - opening);
    at.Box({std::max(0.0F, middle - half), 0.0F, 0.0F},
           {std::min(width, middle + half), kWindowRecess, kLintel}, wall);
  }
  for (int i = 0; i < windows; ++i) {
    const float left = (static_cast<float>(i) + 0.5F) * cell - 0.5F * opening;
    const bool is_door = i == door;
    const float bottom = is_door ? 0.0F : kSill;
    if (!is_door) at.Box({left, 0.0F, 0.0F}, {left + opening, kWindowRecess, kSill}, wall);
    at.Quad({left, kWindowRecess - 0.02F, bottom}, {opening, 0.0F, 0.0F},
            {0.0F, 0.0F, kLintel - bottom}, is_door ? Material::kWood : Material::kGlass);
    // The ledge, or the step before the door.
    at.Box({left - 0.08F, -0.1F, bottom - 0.06F}, {left + opening + 0.08F, 0.0F, bottom},
           Material::kConcrete);
  }
}

void AddRoof(const ShapeBuilder& at, const HouseSize& size, float height, HashStream* random) {
  if (random->Chance(0.3)) {
    const float rim = Draw(random, 0.2, 0.6);
    at.Box({-0.1F, -0.1F, height}, {size.width + 0.1F, size.depth + 0.1F, height + rim},
           Material::kConcrete);
    return;
  }
  constexpr float kOverhang = 0.35F;
  const float rise = 0.5F * size.depth * Draw(random, 0.6, 1.1);
  const float fall = rise * kOverhang / (0.5F * size.depth);
  const float middle = 0.5F * size.depth;
  const Vector3f along(size.width + 2.0F * kOverhang, 0.0F, 0.0F);
  at.Quad({-kOverhang, -kOverhang, height - fall}, along, {0.0F, middle + kOverhang, rise + fall},
          Material::kBrick);
  at.Quad({-kOverhang, size.depth + kOverhang, height - fall}, along,
          {0.0F, -middle - kOverhang, rise + fall}, Material::kBrick);
  for (const float x : {0.0F, size.width}) {
    for (const float y : {0.0F, size.depth}) {
      at.Triangle({x, middle, height}, {0.0F, 0.0F, rise}, {0.0F, y - middle, 0.0F},
                  Material::kPlaster);
    }
  }
  const float x = Draw(random, 0.2, 0.8) * size.width;
  at.Box({x, middle - 1.5F, height}, {x + 0.6F, middle - 0.9F, height + rise + 0.7F},
         Material::kBrick);
}

void AddBalcony(const ShapeBuilder& at, float width) {
  constexpr float kDepth = 1.1F;
  at.Box({0.0F, -kDepth, 0.0F}, {width, 0.0F, 0.15F}, Material::kConcrete);
  at.Box({0.0F, -kDepth, 1.0F}, {width, -kDepth + 0.05F, 1.08F}, Material::kMetal);
  for (float x = 0.0F; x <= width; x += 0.15F) {
    at.Tube({x, -kDepth + 0.02F, 0.15F}, {x, -kDepth + 0.02F, 1.0F}, 0.012F, Material::kMetal);
  }
}

// A point in the unit ball.
Vector3f InBall(HashStream* random) {
  for (;;) {
    const Vector3f p(Draw(random, -1, 1), Draw(random, -1, 1), Draw(random, -1, 1));
    if (p.squaredNorm() <= 1.0F) return p;
  }
}

}  // namespace

void AddHouse(const ShapeBuilder& at, const HouseSize& size, HashStream* random) {
  static constexpr Material kWalls[] = {Material::kPlaster, Material::kBrick, Material::kConcrete};
  const Material wall = kWalls[random->Index(3)];
  const float height = kStoreyHeight * static_cast<float>(size.floors);
  at.Box({0.0F, kWindowRecess, -kFoundation}, {size.width, size.depth, height}, wall);
  at.Box({0.0F, 0.0F, -kFoundation}, {size.width, kWindowRecess, 0.0F}, Material::kConcrete);
  const int windows = std::max(2, static_cast<int>(size.width / Draw(random, 2.4, 3.4)));
  const int door = random->Index(windows);
  for (int floor = 0; floor < size.floors; ++floor) {
    const float z = kStoreyHeight * static_cast<float>(floor);
    AddFacadeStorey(at.At({0.0F, 0.0F, z}), size.width, windows, floor == 0 ? door : -1, wall);
    if (floor > 0 && random->Chance(0.25)) {
      AddBalcony(at.At({Draw(random, 0.5, 0.4 * size.width), 0.0F, z}), 0.5F * size.width);
    }
  }
  AddRoof(at, size, height, random);
}

void AddTree(const ShapeBuilder& at, float crown_radius, HashStream* random) {
  const float trunk = Draw(random, 0.1, 0.22);
  const float crown_height = crown_radius * Draw(random, 0.9, 1.4);
  const float middle = Draw(random, 1.5, 2.2) + crown_height;
  at.Tube({0.0F, 0.0F, -kFoundation}, {Draw(random, -0.2, 0.2), Draw(random, -0.2, 0.2), middle},
          trunk, Material::kWood);
  for (int i = 0; i < 5; ++i) {
    const float angle = Draw(random, 0, 2 * kHalfTurn);
    const float reach = 0.7F * crown_radius;
    at.Tube({0.0F, 0.0F, Draw(random, 2.0, 2.6)},
            {reach * std::cos(angle), reach * std::sin(angle), middle + Draw(random, -0.4, 0.8)},
            0.3F * trunk, Material::kWood);
  }
  const int clusters = 60 + static_cast<int>(40.0F * crown_radius);
  for (int i = 0; i < clusters; ++i) {
    const Vector3f p = InBall(random);
    const float radius = Draw(random, 0.07, 0.22);
    at.Spheroid({(crown_radius - radius) * p.x(), (crown_radius - radius) * p.y(),
                 middle + (crown_height - radius) * p.z()},
                radius, 0.7F * radius, Material::kFoliage);
  }
}

void AddHedge(const ShapeBuilder& at, float length, HashStream* random) {
  const float height = Draw(random, 0.9, 1.9);
  constexpr float kHalfDepth = 0.3F;
  at.Box({0.0F, -kHalfDepth, -kFoundation}, {length, kHalfDepth, height}, Material::kFoliage);
  // Leaf clusters that stand out of the faces make it rough.
  const int clusters = static_cast<int>(length * height * 9.0F);
  for (int i = 0; i < clusters; ++i) {
    const float radius = Draw(random, 0.06, 0.16);
    const float side = random->Chance(0.5) ? kHalfDepth : -kHalfDepth;
    const bool on_top = random->Chance(0.25);
    const float y = on_top ? Draw(random, -kHalfDepth, kHalfDepth) : side;
    const float z = on_top ? height : Draw(random, 0.0, height);
    at.Spheroid({Draw(random, 0.0, length), y, z}, radius, radius, Material::kFoliage);
  }
}

void AddFence(const ShapeBuilder& at, float length, HashStream* random) {
  const float height = Draw(random, 0.9, 1.3);
  const Material material = random->Chance(0.5) ? Material::kWood : Material::kMetal;
  const float pitch = material == Material::kWood ? 0.16F : 0.12F;
  const float half = material == Material::kWood ? 0.04F : 0.01F;
  for (const float z : {0.25F, height - 0.15F}) {
    at.Box({0.0F, 0.01F, z}, {length, 0.04F, z + 0.05F}, material);
  }
  const int pickets = static_cast<int>(length / pitch);
  for (int i = 0; i < pickets; ++i) {
    const float x = (static_cast<float>(i) + 0.5F) * pitch;
    at.Box({x - half, -0.01F, 0.0F}, {x + half, 0.01F, height}, material);
  }
  for (float x = 0.0F; x <= length; x += 2.5F) {
    at.Box({x - 0.05F, -0.02F, -kFoundation}, {x + 0.05F, 0.08F, height + 0.08F}, material);
  }
}

void AddGardenWall(const ShapeBuilder& at, float length, HashStream* random) {
  const float height = Draw(random, 0.5, 1.6);
  at.Box({0.0F, -0.12F, -kFoundation}, {length, 0.12F, height}, Material::kBrick);
  at.Box({0.0F, -0.17F, height}, {length, 0.17F, height + 0.07F}, Material::kConcrete);
}

void AddLamp(const ShapeBuilder& at, HashStream* random) {
  const float height = Draw(random, 5.5, 8.0);
  at.Tube({0.0F, 0.0F, -kFoundation}, {0.0F, 0.0F, height}, 0.07F, Material::kMetal);
  at.Tube({0.0F, 0.0F, -kFoundation}, {0.0F, 0.0F, 1.1F}, 0.11F, Material::kMetal);
  at.Tube({0.0F, 0.0F, height}, {0.0F, -1.6F, height + 0.3F}, 0.04F, Material::kMetal);
  at.Box({-0.12F, -2.1F, height + 0.22F}, {0.12F, -1.5F, height + 0.36F}, Material::kMetal);
}

void AddSign(const ShapeBuilder& at, HashStream* random) {
  const float height = Draw(random, 2.0, 2.6);
  const float half = Draw(random, 0.25, 0.4);
  at.Tube({0.0F, 0.0F, -kFoundation}, {0.0F, 0.0F, height + half}, 0.03F, Material::kMetal);
  at.Box({-0.05F, -half, height - half}, {-0.03F, half, height + half}, Material::kRetroreflector);
}

void AddBin(const ShapeBuilder& at, HashStream* random) {
  const float half = Draw(random, 0.25, 0.5);
  at.Box({-half, -0.3F, -kFoundation}, {half, 0.3F, Draw(random, 0.8, 1.2)}, Material::kMetal);
}

void AddCar(const ShapeBuilder& at, HashStream* random) {
  const bool van = random->Chance(0.2);
  const float length = van ? Draw(random, 4.9, 5.6) : Draw(random, 3.8, 4.7);
  const float half = van ? 0.92F : Draw(random, 0.82, 0.9);
  const float front = 0.5F * length;
  const float waist = van ? 1.15F : Draw(random, 0.85, 1.0);
  const float top = van ? Draw(random, 2.1, 2.4) : Draw(random, 1.38, 1.6);
  at.Box({-front, -half, 0.28F}, {front, half, waist}, Material::kCarPaint);
  // Cabin: roof box, slanted screens fore and aft.
  const float rear = van ? -front + 0.05F : -front + 0.7F;
  const float bonnet = van ? 0.8F : 1.1F;
  const float screen = van ? 0.45F : 0.75F;
  const float inset = 0.08F;
  const float wide = 2.0F * (half - inset);
  const float fore = front - bonnet - screen;
  const float aft = rear + (van ? 0.0F : 0.45F);
  at.Box({aft, -half + inset, waist}, {fore, half - inset, top}, Material::kCarPaint);
  at.Quad({front - bonnet, -half + inset, waist}, {-screen, 0.0F, top - waist}, {0.0F, wide, 0.0F},
          Material::kGlass);
  at.Quad({rear, -half + inset, waist}, {aft - rear, 0.0F, top - waist}, {0.0F, wide, 0.0F},
          Material::kGlass);
  for (const float side : {-half + inset, half - inset}) {
    at.Triangle({fore, side, waist}, {screen, 0.0F, 0.0F}, {0.0F, 0.0F, top - waist},
                Material::kGlass);
  }
  for (const float x : {-front + 0.8F, front - 0.8F}) {
    for (const float y : {-half - 0.01F, half - 0.17F}) {
      at.Tube({x, y, 0.32F}, {x, y + 0.18F, 0.32F}, 0.32F, Material::kAsphalt);
    }
  }
  at.Quad({-front - 0.01F, -0.26F, 0.6F}, {0.0F, 0.52F, 0.0F}, {0.0F, 0.0F, 0.12F},
          Material::kRetroreflector);
}

void AddPedestrian(const ShapeBuilder& at, HashStream* random) {
  const float height = Draw(random, 1.55, 1.9);
  const float step = Draw(random, 0.05, 0.25);
  const float hip = 0.5F * height;
  for (const float side : {-1.0F, 1.0F}) {
    at.Tube({side * step, side * 0.1F, 0.0F}, {0.0F, side * 0.09F, hip}, 0.08F, Material::kCloth);
    at.Tube({-side * step, side * 0.25F, hip}, {0.0F, side * 0.2F, 0.8F * height}, 0.05F,
            Material::kCloth);
  }
  at.Spheroid({0.0F, 0.0F, 0.67F * height}, 0.19F, 0.22F * height, Material::kCloth);
  at.Spheroid({0.0F, 0.0F, height - 0.12F}, 0.1F, 0.12F, Material::kCloth);
}

}  // namespace lamina::synth
