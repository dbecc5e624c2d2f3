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
//
// The rows of a large problem take more memory than all else of it. A sparse H may be assembled
// from those of some planes at a time (AssembleInParts): each block subtracts the products of the
// same planes in the same order, so it has the same bits.
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <vector>

#include "backend/bundle/block_pattern.h"
#include "backend/bundle/block_products.h"
#include "backend/bundle/index.h"
#include "backend/bundle/problem.h"

namespace lamina {

class BundleCost;

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
  // The same for a system without rows: those of about so many observations at a time are asked of
  // their maker, the cost that has made this system.
  void AssembleInParts(const BundleProblem& problem, const BundleIndex& index,
                       const BlockPattern& pattern, const BundleCost& maker,
                       std::size_t observations, Eigen::SparseMatrix<double>* H) const;
  // Observations whose rows are best made at a time: 10 MB of them.
  static constexpr std::size_t kPart = 65536;

 private:
  struct Part;
  // The strip of frame f (see FillStrip) into the upper triangle of H, or out of it.
  static void MoveStrip(const BlockPattern& pattern, std::size_t f, Eigen::SparseMatrix<double>* H,
                        std::vector<double>* strip, bool into);
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

  // Whether the rows may be left out, and made for some planes at a time.
  virtual bool MakesRows() const { return false; }
  // The same without rows. Only if MakesRows().
  virtual void LineariseWithoutRows(const std::vector<SE3>& poses, ReducedSystem* system);
  // The rows of the observations of one plane, at the poses of the last LineariseWithoutRows, which
  // nothing else may have followed.
  virtual void MakeRows(std::size_t plane, ReducedSystem::Rows* rows) const;

  // The cost by which a step from the poses of the last Linearise is judged. At those poses it
  // equals ReducedSystem::cost, up to rounding.
  virtual double Value(const std::vector<SE3>& poses) const = 0;
};

}  // namespace lamina
