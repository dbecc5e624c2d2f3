#include "backend/anchors/anchor_prior.h"

namespace lamina {

RelativePrior PriorOf(const AnchorEdge& edge) {
  RelativePrior prior;
  prior.T_a_b = edge.T_from_to;
  // The translation of an edge is perturbed in the frame of `to`, that of a prior in `from`.
  Matrix6d J = Matrix6d::Identity();
  J.bottomRightCorner<3, 3>() = edge.T_from_to.R().transpose();
  prior.sqrt_information = edge.SquareRootTimes(J);
  return prior;
}

}  // namespace lamina
