// What loops are held against: one another, and where their submaps are taken to be.
//
// Private to backend/loops.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <utility>
#include <vector>

#include "backend/loops/loop.h"
#include "backend/loops/loop_options.h"
#include "backend/places/submap_pairs.h"

namespace lamina {

// Of two poses: how far apart they take a point, and turn.
struct PoseDifference {
  double m = 0.0, rad = 0.0;

  bool Within(const PoseDifference& most) const { return m <= most.m && rad <= most.rad; }
};
// The point is best where two submaps meet: a rotation moves nothing there.
PoseDifference DifferenceAt(const Eigen::Vector3d& p, const SE3& a, const SE3& b);

// What two poses may differ by with this much way between them: so much, and the drift over the way
// (LoopOptions::max_drift_percent, max_drift_deg_per_100m).
PoseDifference WithDrift(const PoseDifference& slack, const LoopOptions& options, double way_m);

// Within what two loops agree that have this much way between them: 0.5 m, 1.5 degrees and the
// drift.
PoseDifference AgreementBound(const LoopOptions& options, double way_m);
// Poses that may differ by more agree by chance.
inline constexpr double kMostAgreeM = 3.0;

// What was found of a pair: refused and why, or waiting.
Loop LoopOf(const SubmapPair& pair, const SubmapMatch& match, const VerificationOptions& options);
// Whether the loop of this pair is where the pair has it, but for what that was not known by.
bool IsWhereExpected(const Loop& loop, const SubmapPair& pair, const PlaceImage& query);

// By (distance, position): the nearest alone, in their order.
void KeepNearest(std::size_t most, std::vector<std::pair<double, std::size_t>>* near);

}  // namespace lamina
