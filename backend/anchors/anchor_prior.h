// An edge between anchors as a prior of bundle adjustment.
#pragma once

#include "backend/anchors/anchor_graph.h"
#include "backend/bundle/problem.h"

namespace lamina {

// Its a and b are the caller's to set.
RelativePrior PriorOf(const AnchorEdge& edge);

}  // namespace lamina
