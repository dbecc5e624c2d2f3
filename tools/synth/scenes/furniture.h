// What stands in rooms: each function adds the primitives of one object. Metres, standing on z = 0.
#pragma once

#include "tools/synth/engine/primitive.h"
#include "tools/synth/engine/random.h"

namespace lamina::synth {

// Centred on the origin.
void AddTable(const ShapeBuilder& at, float length, float width, float height);
void AddChair(const ShapeBuilder& at);
void AddPlant(const ShapeBuilder& at, HashStream* random);
void AddSofa(const ShapeBuilder& at);

// Open in front (y = 0), against a wall behind, from x = 0 to `width`; filled with books and boxes.
void AddShelf(const ShapeBuilder& at, float width, float height, HashStream* random);

// On a wall along x, at y = 0: a frame that stands out of it by `depth` towards y > 0.
void AddWallFrame(const ShapeBuilder& at, float width, float low, float high, float depth,
                  Material filling);

}  // namespace lamina::synth
