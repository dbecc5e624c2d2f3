// An edge between anchors as a prior of bundle adjustment.
#pragma once

#include "backend/bundle/problem.h"
#include "backend/submaps/anchor_graph.h"

namespace lamina {

// Its a and b are the caller's to set.
RelativePrior PriorOf(const AnchorEdge& edge);

}  // namespace lamina
