#include "tools/synth/scenes/furniture.h"

#include <cmath>

namespace lamina::synth {
namespace {

using Eigen::Vector3f;

}  // namespace

void AddTable(const ShapeBuilder& at, float length, float width, float height) {
  const float x = 0.5F * length;
  const float y = 0.5F * width;
  at.Box({-x, -y, height - 0.04F}, {x, y, height}, Material::kWood);
  for (const float sx : {-1.0F, 1.0F}) {
    for (const float sy : {-1.0F, 1.0F}) {
      const Vector3f foot(sx * (x - 0.05F), sy * (y - 0.05F), 0.0F);
      at.Box(foot - Vector3f(0.03F, 0.03F, 0.0F), foot + Vector3f(0.03F, 0.03F, height - 0.04F),
             Material::kWood);
    }
  }
}

void AddChair(const ShapeBuilder& at) {
  AddTable(at, 0.42F, 0.42F, 0.46F);
  at.Box({-0.21F, 0.18F, 0.46F}, {0.21F, 0.21F, 0.92F}, Material::kWood);
}

void AddShelf(const ShapeBuilder& at, float width, float height, HashStream* random) {
  constexpr float kDepth = 0.34F;
  at.Box({0.0F, kDepth - 0.02F, 0.0F}, {width, kDepth, height}, Material::kWood);
  for (const float x : {0.0F, 0.5F * width, width}) {
    at.Box({x - 0.01F, 0.0F, 0.0F}, {x + 0.01F, kDepth, height}, Material::kWood);
  }
  for (float z = 0.05F; z < height; z += 0.36F) {
    at.Box({0.0F, 0.0F, z}, {width, kDepth, z + 0.02F}, Material::kWood);
    for (float x = 0.05F; x < width - 0.2F; x += Draw(random, 0.08, 0.35)) {
      const float wide = Draw(random, 0.03, 0.16);
      at.Box({x, Draw(random, 0.03, 0.12), z + 0.02F},
             {x + wide, kDepth - 0.03F, z + Draw(random, 0.15, 0.3)}, Material::kCloth);
      x += wide;
    }
  }
}

void AddPlant(const ShapeBuilder& at, HashStream* random) {
  at.Tube({0.0F, 0.0F, 0.0F}, {0.0F, 0.0F, 0.35F}, 0.16F, Material::kBrick);
  for (int i = 0; i < 70; ++i) {
    const float angle = Draw(random, 0, 6.28);
    const float reach = Draw(random, 0.0, 0.4);
    at.Spheroid({reach * std::cos(angle), reach * std::sin(angle), Draw(random, 0.4, 1.3)},
                Draw(random, 0.03, 0.07), 0.02F, Material::kFoliage);
  }
}

void AddSofa(const ShapeBuilder& at) {
  at.Box({-1.0F, -0.4F, 0.1F}, {1.0F, 0.45F, 0.42F}, Material::kCloth);
  at.Box({-1.0F, 0.25F, 0.42F}, {1.0F, 0.45F, 0.85F}, Material::kCloth);
  for (const float x : {-1.0F, 0.82F}) {
    at.Box({x, -0.4F, 0.42F}, {x + 0.18F, 0.25F, 0.62F}, Material::kCloth);
  }
}

void AddWallFrame(const ShapeBuilder& at, float width, float low, float high, float depth,
                  Material filling) {
  constexpr float kBar = 0.08F;
  at.Box({-kBar, 0.0F, low - kBar}, {width + kBar, depth, low}, Material::kWood);
  at.Box({-kBar, 0.0F, high}, {width + kBar, depth, high + kBar}, Material::kWood);
  at.Box({-kBar, 0.0F, low}, {0.0F, depth, high}, Material::kWood);
  at.Box({width, 0.0F, low}, {width + kBar, depth, high}, Material::kWood);
  at.Quad({0.0F, 0.01F, low}, {width, 0.0F, 0.0F}, {0.0F, 0.0F, high - low}, filling);
}

}  // namespace lamina::synth
