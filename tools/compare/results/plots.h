// Figures 2 and 4 of the paper.
#pragma once

#include <string>
#include <vector>

#include "tools/compare/results/tables.h"

namespace lamina {

// Distribution of the structural error of each method: shares of the map's points by distance,
// 0..5 cm, the mean over the sequences. Nothing is drawn if no row has it. Throws OutputError.
void DrawStructuralErrors(const std::string& path, const CompareTable& table);

struct ResolutionPoint {
  std::string curve;
  double resolution_m = 0.0;
  double ape_cm = 0.0, solve_ms = 0.0;
  std::size_t planes = 0;  // of the last round
  int iterations = 0;      // of all rounds
};

// Error and solve time against the resolution of the input, a panel each.
void DrawResolutionStudy(const std::string& path, const std::vector<ResolutionPoint>& points);

}  // namespace lamina
