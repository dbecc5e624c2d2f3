// Scenes of simple surfaces and hard circumstances, in which scan matching is tried.
//
//   bays   a street: flat ground, and on both sides, 8 m from its middle, a facade of bays of 5 m
//          that stand out by 0 to 1.5 m, with side faces between them. By car.
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "tools/synth_motion.h"
#include "tools/synth_movers.h"
#include "tools/synth_scene.h"

namespace lamina::synth {

// What a scene consists of, for a sensor that moves steadily along x.
struct TrialScene {
  std::unique_ptr<SceneModel> model;
  std::shared_ptr<const UprightPath> path;
  HandheldShake shake;
  std::vector<Mover> movers;
};

bool IsTrialScene(SceneKind kind);
// `kind` must be one of those above.
TrialScene MakeTrialScene(SceneKind kind, double speed_m_per_s, std::int64_t seed);

}  // namespace lamina::synth
