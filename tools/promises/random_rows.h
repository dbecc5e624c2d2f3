// Promises for scenes drawn at random: a place, a sensor, a motion and what else befalls a
// recording, in combinations that no table names.
//
// Drawn is whatever the generator has (tools/synth) in the company in which it occurs:
//
//   car     street, city, bays, lorry, carpark, field, tunnel; the default configuration
//   foot    forest, pavement
//   indoor  room, stairs, hall, glass, corridor, lift
//   all     one of these three for each row
//
// What is carried on foot or indoors has `handheld`, an Avia `livox_avia`. No sensor is spun on a
// car, and no scans are picked indoors, where some metres on is another room. 100 scans a row.
//
// Promised is what tools/promises/promises.md promises everywhere: 0.10 m, indoors 0.05 m, nothing
// lost and nothing degenerate, but for scans of spray and in places of which a direction cannot be
// told (field, tunnel, corridor, lift), where both are free. A scene that does not hold enough for
// its sensor is drawn as well: what such a row says must be judged, it is no verdict.
#pragma once

#include <string>
#include <vector>

#include "tools/promises/promises.h"

namespace lamina {

enum class RandomPlaces { kCar, kFoot, kIndoor, kAll };
// In the order of RandomPlaces.
const std::vector<std::string>& RandomPlacesNames();

// Row i depends on `seed`, `places` and i alone. Each has a `--seed` of its own, and a name that
// says what was drawn. `rows` >= 0.
std::vector<Promise> DrawPromises(int rows, int seed, RandomPlaces places);

}  // namespace lamina
