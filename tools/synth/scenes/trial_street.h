// Endless streets and places along x, of simple surfaces. What is driven or walked along y =
// kTrialMiddle is free of them.
#pragma once

#include <cstdint>
#include <memory>

#include "tools/synth/engine/scene.h"

namespace lamina::synth {

inline constexpr double kTrialMiddle = 150.0;

// A street of facades of bays.
std::unique_ptr<SceneModel> MakeBays(std::int64_t seed);
// Flat ground and nothing else.
std::unique_ptr<SceneModel> MakeField();
// Floor, walls and vault without any mark.
std::unique_ptr<SceneModel> MakeTunnel();
// Trunks with crowns above.
std::unique_ptr<SceneModel> MakeForest(std::int64_t seed);
// Rows of parked cars between walls.
std::unique_ptr<SceneModel> MakeCarPark(std::int64_t seed);
// A pavement 2.5 m from a wall with pilasters.
std::unique_ptr<SceneModel> MakePavement(std::int64_t seed);
// A corridor with rooms behind panes on the left, doors in a wall on the right.
std::unique_ptr<SceneModel> MakeGlassCorridor(std::int64_t seed);
// A lift's cabin, closed but for its front: kLiftFront metres ahead of the middle.
std::unique_ptr<SceneModel> MakeLift();
inline constexpr double kLiftFront = 0.8;

}  // namespace lamina::synth
