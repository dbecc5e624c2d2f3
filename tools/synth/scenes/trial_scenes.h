// Scenes of simple surfaces and hard circumstances, in which scan matching is tried. The way is
// straight, along x, and endless.
//
//   bays       a street: flat ground, and on both sides, 8 m from its middle, a facade of bays of
//              5 m that stand out by 0 to 1.5 m, with side faces between them. By car
//   lorry      the same, with a lorry beside the car, at its speed but for 1 m/s
//   field      flat ground, and nothing else: two translations and a turn cannot be told
//   tunnel     floor, walls and vault without a mark: motion along it cannot be told
//   forest     trunks, crowns and undergrowth, on foot
//   carpark    parked cars and walls; vans that keep driving about the sensor return 40 % of the
//              points
//   pavement   on foot, 2.5 m from a wall; people walk along it at the sensor's speed
//   glass      a corridor with rooms behind panes, which most rays pass or are mirrored by
//   lift       in a closed cabin, through whose open front one sees the shaft go by. The world is
//              the cabin: nothing moves, but much seems to
#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "tools/synth/engine/movers.h"
#include "tools/synth/engine/scene.h"
#include "tools/synth/motion/motion.h"

namespace lamina::synth {

// What a scene consists of, for a sensor that moves steadily.
struct TrialScene {
  std::unique_ptr<SceneModel> model;
  std::shared_ptr<const UprightPath> path;
  HandheldShake shake;
  std::vector<Mover> movers;
};

bool IsTrialScene(SceneKind kind);
// Metres per second; in the lift, of the shaft.
double TrialSpeed(SceneKind kind);
// `kind` must be one of those above.
TrialScene MakeTrialScene(SceneKind kind, double speed_m_per_s, std::int64_t seed);

}  // namespace lamina::synth
