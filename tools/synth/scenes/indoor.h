// Scenes within walls, and the paths on which a sensor is carried through them.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>

#include "tools/synth/engine/scene.h"
#include "tools/synth/motion/motion.h"

namespace lamina::synth {

inline constexpr double kSensorInHand = 1.4;  // metres above the floor

// A furnished room of 8 x 6 x 3 m.
std::unique_ptr<SceneModel> MakeRoom(std::int64_t seed);
// An endless straight corridor along x: two walls, floor, ceiling, and nothing else. Where the
// sensor is along it cannot be told from any scan.
std::unique_ptr<SceneModel> MakeCorridor();
// A stairwell of six storeys: flights of steps, landings, rails, doors.
std::unique_ptr<SceneModel> MakeStairs(std::int64_t seed);
// A hall of 60 x 30 x 8 m with pillars, beams and crates.
std::unique_ptr<SceneModel> MakeHall(std::int64_t seed);

// A path through the scene at the height of a carried sensor. `kind` must not be kStreet.
std::shared_ptr<const UprightPath> MakeIndoorPath(SceneKind kind, double speed_m_per_s);

}  // namespace lamina::synth
