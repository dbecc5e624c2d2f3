// Straight streets of simple surfaces; their middle is at y = kTrialStreetWidth / 2.
#pragma once

#include <cstdint>
#include <memory>

#include "tools/synth_scene.h"

namespace lamina::synth {

inline constexpr double kTrialStreetWidth = 24.0;  // of the block, metres
inline constexpr double kSensorOnCar = 1.73;       // above the road, metres

std::unique_ptr<SceneModel> MakeBays(std::int64_t seed);

}  // namespace lamina::synth
