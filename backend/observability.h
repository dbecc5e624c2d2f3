// What a bundle problem can determine, and what it cannot, before it is solved.
//
// Three things make a batch ill-posed, and each is found by frame:
//   too few planes   a frame shares fewer planes with others than it takes to hold six directions
//   apart            a group of frames shares no plane with the largest group
//   open direction   no plane that a frame sees resists a motion along it: all planes parallel, an
//                    endless corridor, turns about the axis of a tunnel
//
// The last is judged as in matching (frontend/degeneracy.h), with the rows of the condensed cost: a
// direction is open where what faces it leaves it less certain than `max_direction_sigma_m`.
//
// Holding what was found (BundleProblem::holds) makes the rest solvable.
#pragma once

#include <string>
#include <vector>

#include "backend/bundle_problem.h"
#include "core/options.h"

namespace lamina {

struct ObservabilityOptions {
  // Planes that a frame must share with other frames.
  int min_shared_planes = 3;
  // Standard deviation beyond which a direction counts as open.
  double max_direction_sigma_m = 0.2;

  void Visit(OptionVisitor& v);
};

struct BundleFault {
  enum class Kind { kTooFewPlanes, kApart, kOpenDirection, kLeapt };
  // kLeapt: found in the solve, not before it (batch_registration.h).
  Kind kind = Kind::kTooFewPlanes;
  int frame = 0;
  int shared_planes = 0;                  // kTooFewPlanes
  std::vector<int> group;                 // kApart: the frames that hang together
  Vector6d direction = Vector6d::Zero();  // kOpenDirection: unit tangent vector
  double sigma_m = 0.0;                   // kOpenDirection; infinite where nothing faces it
  // A sentence that names frame and direction.
  std::string Describe() const;
};

struct Observability {
  std::vector<BundleFault> faults;
  // Gauge and open directions: for BundleProblem::holds, with hold_first_pose false.
  std::vector<HeldDirection> holds;
  std::vector<int> free_frames;  // frames with anything left to determine
};

// At the problem's start values. Deterministic; thread-safe.
Observability FindObservability(const BundleProblem& problem, const ObservabilityOptions& options);

}  // namespace lamina
