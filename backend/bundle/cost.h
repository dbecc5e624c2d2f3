// What a solver asks of a formulation of bundle adjustment, and the normal equations that it gets.
//
// Every formulation whose planes are eliminated gives normal equations of one shape,
//
//     H = blockdiag(D_1 .. D_N) - sum_planes W_p' W_p,     W_p = [W_p1 .. W_pN],  W_pk 3x6
//
// D_k from frame k alone, W_p from the three variables (two angles, one offset) of plane p. A
// formulation that holds the planes during a step has no W: its frames decouple. Forming D and W
// costs one pass over the observations; multiplying out W'W is what grows with the square of the
// observations of a plane. Neither ever grows with points.
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <vector>

#include "backend/bundle/block_pattern.h"
#include "backend/bundle/block_products.h"
#include "backend/bundle/index.h"
#include "backend/bundle/problem.h"

namespace lamina {

struct ReducedSystem {
  using Rows = PlaneRows;

  double cost = 0.0;
  Eigen::VectorXd gradient;        // 6N, tangent [rotation; translation] of core/geometry/se3.h
  std::vector<Matrix6d> diagonal;  // D, N blocks
  std::vector<Rows> rows;          // W_pk of each observation; empty if frames decouple

  // H, both triangles. Parallel over frames; same bits at any number of threads.
  void Assemble(const BundleProblem& problem, const BundleIndex& index, Eigen::MatrixXd* H) const;
  // The upper triangle of H. Its structure is made when *H is empty, and must not change later.
  void Assemble(const BundleProblem& problem, const BundleIndex& index, const BlockPattern& pattern,
                Eigen::SparseMatrix<double>* H) const;

 private:
  // The blocks of H right of frame f's row up to the diagonal, 6x6 column-major at each frame.
  void FillStrip(const BundleProblem& problem, const BundleIndex& index, std::size_t f,
                 std::vector<double>* strip) const;
};

class BundleCost {
 public:
  virtual ~BundleCost() = default;

  // Cost, gradient and (approximate) Hessian at these poses. A formulation that holds its planes
  // during a step takes them from here.
  virtual void Linearise(const std::vector<SE3>& poses, ReducedSystem* system) = 0;

  // Cost and gradient alone; what else the system has is not to be used.
  virtual void FindGradient(const std::vector<SE3>& poses, ReducedSystem* system) {
    Linearise(poses, system);
  }

  // The cost by which a step from the poses of the last Linearise is judged. At those poses it
  // equals ReducedSystem::cost, up to rounding.
  virtual double Value(const std::vector<SE3>& poses) const = 0;
};

}  // namespace lamina
