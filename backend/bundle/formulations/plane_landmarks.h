// Formulation `plane_landmarks`: planes as landmarks, estimated beside the poses (LIPS: Geneva,
// Eckenhoff, Yang, Huang, "LIPS: LiDAR-Inertial 3D Plane SLAM", IROS 2018).
//
// A plane is its closest point to an anchor, Pi = d nu, d > 0. What a frame has measured of it is
// the plane fitted to its own cluster, Pi_k, in the LiDAR frame; the residual is
//
//     W_k (Pi(predicted in frame k) - Pi_k),     W_k'W_k = information of the fit
//
// LIPS takes the closest point to the origin, where a plane through the origin has none. Here a
// measurement's anchor lies 1 m off the cluster's mean along its normal, so d = 1 and, with l, u
// the cluster's eigenpairs, the information of the fit is n (l1 u1 u1' + l2 u2 u2' + u3 u3'); a
// plane's own anchor lies likewise off its mean at the start values.
//
// Ceres estimates planes and poses together; its Schur solver eliminates the planes.
//
// Private to backend/bundle/formulations.
#pragma once

#include "backend/bundle/solver/formulation.h"

namespace lamina {

BundleResult SolvePlaneLandmarks(const BundleProblem& problem, const BundleAdjusterOptions& options,
                                 const BundleObserver& observer);

const Formulation& PlaneLandmarksFormulation();

}  // namespace lamina
