// The held directions of a bundle problem, as orthonormal bases.
#pragma once

#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <cstddef>
#include <vector>

#include "backend/bundle/block_pattern.h"
#include "backend/bundle/problem.h"

namespace lamina {

using HeldSpace = Eigen::Matrix<double, 6, Eigen::Dynamic, 0, 6, 6>;

// For each frame, orthonormal columns that span the tangent vectors along which it must not move
// (BundleProblem::holds, hold_first_pose): 0 to 6 of them. `scale` is applied to the vectors first,
// for solvers that count rotations in other units.
std::vector<HeldSpace> HeldSpaces(const BundleProblem& problem,
                                  const Vector6d& scale = Vector6d::Ones());

// Takes held directions out of normal equations H x = -g by projection. With B_k the held space of
// frame k and P_k = I - B_k B_k',
//
//     H_jk -> P_j H_jk P_k,   H_kk -> P_k H_kk P_k + s B_k B_k',   g_k -> P_k g_k
//
// so that nothing couples to them, and the solution has no part along them. s is the largest entry
// on the diagonal of H, so that its condition stays what it was.
class HeldDirections {
 public:
  explicit HeldDirections(const BundleProblem& problem);

  // All frames with the held ones, and P_k; exactly zero for a frame that is held as a whole.
  struct Frame {
    std::size_t frame;
    HeldSpace space;
    Matrix6d projector;
  };
  const std::vector<Frame>& frames() const { return frames_; }

  void TakeOut(Eigen::MatrixXd* H) const;
  // The same of frames that decouple.
  void TakeOut(std::vector<Matrix6d>* diagonal) const;
  // The same of the upper triangle of H, which has the structure of this pattern.
  void TakeOut(const BlockPattern& pattern, Eigen::SparseMatrix<double>* H) const;
  // Of a gradient, or of columns of right sides, six rows a frame.
  template <typename Derived>
  void Project(Eigen::MatrixBase<Derived>* g) const {
    for (const Frame& f : frames_) {
      auto part = g->template middleRows<6>(static_cast<Eigen::Index>(6 * f.frame));
      part = (f.projector * part).eval();
    }
  }

  // Damping D of a frame some of whose directions are held couples to none of these: P D P. Calls
  // add(frame, what comes to its block of D).
  template <typename Add>
  void ForEachDamping(const Eigen::VectorXd& damping, const Add& add) const {
    for (const Frame& f : frames_) {
      if (f.space.cols() == 6) continue;  // uncoupled as it is
      const Matrix6d D = damping.segment<6>(static_cast<Eigen::Index>(6 * f.frame)).asDiagonal();
      add(f.frame, (f.projector * D * f.projector - D).eval());
    }
  }

 private:
  std::vector<Frame> frames_;
};

}  // namespace lamina
