// Decompositions of 6 x 6 matrices, which are compiled once, in decompositions.cc, and not in each
// file that factors the information of a pose: there they would take a quarter of the compiler's
// time. Changes nothing for the code that calls them, nor for that which does not see this header.
//
// What is given to them must be a Matrix6d: of an expression Eigen makes a decomposition of its
// own.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <Eigen/SVD>

namespace lamina {
namespace decompositions {

using Matrix6 = Eigen::Matrix<double, 6, 6>;
using Vector6 = Eigen::Matrix<double, 6, 1>;
using Identity6 = Matrix6::IdentityReturnType;

}  // namespace decompositions
}  // namespace lamina

// `EXTERN` is `extern` where they are used and nothing where they are compiled.
#define LAMINA_DECOMPOSITIONS(EXTERN)                                                              \
  EXTERN template Eigen::SelfAdjointEigenSolver<lamina::decompositions::Matrix6>&                  \
  Eigen::SelfAdjointEigenSolver<lamina::decompositions::Matrix6>::compute(                         \
      const Eigen::EigenBase<lamina::decompositions::Matrix6>&, int);                              \
  EXTERN template Eigen::LLT<lamina::decompositions::Matrix6>&                                     \
  Eigen::LLT<lamina::decompositions::Matrix6>::compute(                                            \
      const Eigen::EigenBase<lamina::decompositions::Matrix6>&);                                   \
  EXTERN template Eigen::LDLT<lamina::decompositions::Matrix6>&                                    \
  Eigen::LDLT<lamina::decompositions::Matrix6>::compute(                                           \
      const Eigen::EigenBase<lamina::decompositions::Matrix6>&);                                   \
  EXTERN template void Eigen::LDLT<lamina::decompositions::Matrix6>::_solve_impl_transposed<true>( \
      const lamina::decompositions::Vector6&, lamina::decompositions::Vector6&) const;             \
  EXTERN template void Eigen::LDLT<lamina::decompositions::Matrix6>::_solve_impl_transposed<true>( \
      const lamina::decompositions::Identity6&, lamina::decompositions::Matrix6&) const;           \
  EXTERN template Eigen::PartialPivLU<lamina::decompositions::Matrix6>::PartialPivLU(              \
      const Eigen::EigenBase<lamina::decompositions::Matrix6>&);                                   \
  EXTERN template void Eigen::PartialPivLU<lamina::decompositions::Matrix6>::compute();            \
  EXTERN template struct Eigen::internal::compute_inverse<lamina::decompositions::Matrix6,         \
                                                          lamina::decompositions::Matrix6, 6>;     \
  EXTERN template Eigen::JacobiSVD<Eigen::Matrix3d>& Eigen::JacobiSVD<Eigen::Matrix3d>::compute(   \
      const Eigen::Matrix3d&, unsigned int);

LAMINA_DECOMPOSITIONS(extern)
