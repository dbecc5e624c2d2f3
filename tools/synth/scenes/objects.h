// What stands in a synthetic street: each function adds the primitives of one object.
//
// All take a builder placed on the ground where the object stands, and draw their proportions from
// a HashStream. Metres; x along the object's front, y away from it (a car: x forward), z up.
#pragma once

#include "tools/synth/engine/primitive.h"
#include "tools/synth/engine/random.h"

namespace lamina::synth {

// Facade on y = 0 from x = 0 to `width`, the house behind it (y > 0). Windows and doors are
// recessed into the facade; the roof is gabled or flat.
struct HouseSize {
  float width, depth;
  int floors;
};
void AddHouse(const ShapeBuilder& at, const HouseSize& size, HashStream* random);

// A trunk, some branches, and a crown of leaf clusters with gaps between them.
void AddTree(const ShapeBuilder& at, float crown_radius, HashStream* random);

// Along x from 0 to `length`.
void AddHedge(const ShapeBuilder& at, float length, HashStream* random);
void AddFence(const ShapeBuilder& at, float length, HashStream* random);
void AddGardenWall(const ShapeBuilder& at, float length, HashStream* random);

// Lamp with an arm towards -y; traffic sign facing -x.
void AddLamp(const ShapeBuilder& at, HashStream* random);
void AddSign(const ShapeBuilder& at, HashStream* random);
void AddBin(const ShapeBuilder& at, HashStream* random);

// Centred on the origin, standing on z = 0.
void AddCar(const ShapeBuilder& at, HashStream* random);
void AddPedestrian(const ShapeBuilder& at, HashStream* random);

}  // namespace lamina::synth
