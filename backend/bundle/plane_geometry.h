// What every formulation needs of a plane at given poses: the aggregate of its clusters, and its
// frame of eigenvectors.
#pragma once

#include <Eigen/Core>
#include <vector>

#include "backend/bundle/problem.h"

namespace lamina {

// Rotations as matrices, made once an evaluation.
struct PoseMatrices {
  explicit PoseMatrices(const std::vector<SE3>& poses);
  std::vector<Eigen::Matrix3d> R;
  std::vector<Eigen::Vector3d> t;
};

// fixed + sum_k (cluster_k moved by pose k), world frame (paper, III-B2).
PointCluster AggregatePlane(const BundleProblem& problem, const Plane& plane,
                            const PoseMatrices& poses);
PointCluster AggregatePlane(const BundleProblem& problem, const Plane& plane,
                            const std::vector<SE3>& poses);

// The aggregate's mean and eigenpairs, world frame; u1 x u2 = normal.
struct PlaneFrame {
  Eigen::Vector3d normal, u1, u2, mean;
  Eigen::Vector3d l;  // l1 >= l2 >= l3 >= 0
  double count = 0.0;
};

PlaneFrame MakePlaneFrame(const PointCluster& aggregate);

// The frames of all planes, in parallel.
std::vector<PlaneFrame> MakePlaneFrames(const BundleProblem& problem, const PoseMatrices& poses);

// The inverse roots of what the plane's own variables (two angles, offset) weigh in the normal
// equations: sqrt(weight) * (N diag(l1 - subtract, l2 - subtract, 1))^-1/2. A plane with no extent
// along u_j cannot turn about the other axis: zero, no such variable then.
Eigen::Vector3d PlaneRoots(const PlaneFrame& frame, double weight, double subtract);

// sum_planes 1/2 weight N lambda_3: the cost by which all formulations are compared. Parallel over
// planes in fixed chunks: the same bits at any number of threads.
double EigenvalueCost(const BundleProblem& problem, const std::vector<SE3>& poses);
double EigenvalueCost(const BundleProblem& problem, const std::vector<PlaneFrame>& frames);

// 1/2 sum weight n_k l3_k: what that cannot fall below, whatever the poses (paper, eq. 9 and 10).
double EigenvalueLowerBound(const BundleProblem& problem);

}  // namespace lamina
