// Groups of frames that the planes between them hold together as one body.
//
// Two groups join when the planes that both see determine all six directions of one against the
// other (tied_planes.h, about where the LiDARs stood that saw them): along each eigenvector of that
// information the standard deviation is at most `max_sigma_m`, the rule for single frames
// (observability.h). Only what lies between the two counts, so a chain of frames is one group
// however long it is: the uncertainty that it gathers on its way is no gap.
//
// Groups grow from one frame, by those first that share most planes with it; what has grown joins
// again in the same way, until nothing changes. Cost: about one pass over the observations for each
// repetition. Deterministic.
//
// A frame's own open directions are held (BundleProblem::holds): they keep no frame out of a group
// that determines the rest of it.
//
// Private to backend/bundle/uncertainty.
#pragma once

#include <vector>

#include "backend/bundle/uncertainty/tied_planes.h"

namespace lamina {

struct FrameGroup {
  std::vector<int> frames;  // ascending; empty for what has joined another group
  // The held directions of its frames; none unless each of them has one, since the others would be
  // free to move along them.
  std::vector<HeldDirection> holds;
  bool stands = false;  // at the gauge, or at fixed clusters
};

struct RigidGroups {
  std::vector<FrameGroup> groups;  // as many as there are frames, and one for what is fixed
  TiedPlanes tied;                 // by group
};

// Of the usable frames; open[k] are the held directions of frame k.
RigidGroups FindRigidGroups(const BundleProblem& problem, const std::vector<PlaneFrame>& frames,
                            const std::vector<bool>& usable,
                            const std::vector<std::vector<HeldDirection>>& open,
                            double max_sigma_m);

// Joins what can join, after a change of what stands.
void JoinRigidGroups(const std::vector<SE3>& poses, double max_sigma_m, RigidGroups* rigid);

// Joins groups with those of the numbers given.
void JoinGroups(const std::vector<int>& into, RigidGroups* rigid);

}  // namespace lamina
