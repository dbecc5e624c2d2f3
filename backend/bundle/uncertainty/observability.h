// What a bundle problem can determine, and what it cannot, before it is solved.
//
// Four things make a batch ill-posed:
//   too few planes   a frame shares fewer planes with others than it takes to hold six directions
//   apart            a group of frames shares no plane with the largest group
//   open direction   no plane that a frame sees resists a motion along it: all planes parallel, an
//                    endless corridor, turns about the axis of a tunnel
//   sliding group    frames that are determined among themselves, but not against the others: two
//                    rooms that have the floor in common, and nothing else
//
// A frame's directions are judged as in matching (core/geometry/degeneracy.h), with the rows of
// the condensed cost: a direction is open where what faces it leaves it less certain than
// `max_direction_sigma_m`. The same holds for the directions of a group against what it shares
// planes with (rigid_groups.h, sliding_groups.h). A gap between neighbours makes a group, not the
// drift that a long chain gathers: neither a corridor of thousands of frames nor a loop is one.
//
// The first frame of the largest rigid group holds the gauge; what slides is named against that.
// Holding what was found (BundleProblem::holds) makes the rest solvable.
#pragma once

#include <string>
#include <vector>

#include "backend/bundle/problem.h"
#include "core/options/options.h"

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
  int shared_planes = 0;  // kTooFewPlanes
  // kApart: the frames that hang together. kOpenDirection: those that slide as one, of which
  // `frame` is held; empty if it is the frame alone.
  std::vector<int> group;
  // kOpenDirection: unit tangent vector. Of a group, the twist of the world about the held frame's
  // LiDAR.
  Vector6d direction = Vector6d::Zero();
  std::vector<Vector6d> motion;  // of each of a sliding group: its tangent vector in that twist
  double sigma_m = 0.0;          // kOpenDirection; infinite where nothing faces it
  // A sentence that names frame and direction.
  std::string Describe() const;
};

struct Observability {
  std::vector<BundleFault> faults;
  // Gauge and open directions: for BundleProblem::holds, with hold_first_pose false.
  std::vector<HeldDirection> holds;
  std::vector<int> free_frames;  // frames with anything left to determine
};

// Whether sliding groups are looked for. They are left free where planes may only seem to be
// different ones, because the poses are poor.
enum class Slides { kHeld, kFree };

// At the problem's start values. Deterministic; thread-safe.
Observability FindObservability(const BundleProblem& problem, const ObservabilityOptions& options,
                                Slides slides = Slides::kHeld);

}  // namespace lamina
