// What loops are held against: one another, and where their submaps are taken to be.
//
// Private to backend/loops.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <utility>
#include <vector>

#include "backend/loops/loop_closure.h"
#include "backend/places/submap_pairs.h"

namespace lamina {

// Loops agree within this and the drift between them, which must be short enough to tell.
inline constexpr double kAgreeM = 0.5, kAgreeDeg = 1.5, kMostAgreeM = 3.0;

// Of two poses: how far apart they take a point, and turn.
struct PoseDifference {
  double m = 0.0, rad = 0.0;

  bool Within(double most_m, double most_rad) const { return m <= most_m && rad <= most_rad; }
};
// The point is best where two submaps meet: a rotation moves nothing there.
PoseDifference DifferenceAt(const Eigen::Vector3d& p, const SE3& a, const SE3& b);

// What was found of a pair: refused and why, or waiting.
Loop LoopOf(const SubmapPair& pair, const SubmapMatch& match, const VerificationOptions& options);
// Whether the loop of this pair is where the pair has it, but for what that was not known by.
bool IsWhereExpected(const Loop& loop, const SubmapPair& pair, const PlaceImage& query);

// By (distance, position): the nearest alone, in their order.
void KeepNearest(std::size_t most, std::vector<std::pair<double, std::size_t>>* near);

}  // namespace lamina
