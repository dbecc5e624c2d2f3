#include "backend/bundle/formulations/eigen_factors.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include "backend/bundle/frame_pass.h"
#include "core/base/parallel.h"

namespace lamina {
namespace {

Matrix4d Homogeneous(const PointCluster& c) {
  Matrix4d S;
  S.topLeftCorner<3, 3>() = c.scatter.Dense() + c.count * c.mean * c.mean.transpose();
  S.topRightCorner<3, 1>() = c.count * c.mean;
  S.bottomLeftCorner<1, 3>() = c.count * c.mean.transpose();
  S(3, 3) = c.count;
  return S;
}

// L' with L L' = S.
Matrix4d TransposedRoot(const Matrix4d& S) {
  const Eigen::LLT<Matrix4d> llt(S);
  if (llt.info() == Eigen::Success) return llt.matrixU();
  const Eigen::SelfAdjointEigenSolver<Matrix4d> eigen(S);
  const Eigen::Vector4d roots = eigen.eigenvalues().cwiseMax(0.0).cwiseSqrt();
  return eigen.eigenvectors() * roots.asDiagonal() * eigen.eigenvectors().transpose();
}

Matrix4d Homogeneous(const Eigen::Matrix3d& R, const Eigen::Vector3d& t) {
  Matrix4d T = Matrix4d::Identity();
  T.topLeftCorner<3, 3>() = R;
  T.topRightCorner<3, 1>() = t;
  return T;
}

// y = T' pi.
Eigen::Vector4d PlaneInFrame(const Eigen::Vector4d& pi, const Eigen::Matrix3d& R,
                             const Eigen::Vector3d& t) {
  Eigen::Vector4d y;
  y << R.transpose() * pi.head<3>(), pi.head<3>().dot(t) + pi(3);
  return y;
}

Eigen::Matrix<double, 4, 6> PlaneByPose(const Eigen::Vector4d& pi, const Eigen::Vector4d& y) {
  Eigen::Matrix<double, 4, 6> Y = Eigen::Matrix<double, 4, 6>::Zero();
  Y.topLeftCorner<3, 3>() = Hat(y.head<3>());
  Y.bottomRightCorner<1, 3>() = pi.head<3>().transpose();
  return Y;
}

}  // namespace

EigenFactorsCost::EigenFactorsCost(const BundleProblem& problem)
    : problem_(problem), index_(problem) {
  for (const PlaneObservation& o : problem.observations) {
    S_.push_back(Homogeneous(o.cluster));
    roots_.push_back(TransposedRoot(S_.back()));
  }
  for (const Plane& plane : problem.planes) fixed_.push_back(Homogeneous(plane.fixed));
}

std::vector<EigenFactorsCost::Factor> EigenFactorsCost::Factors(
    const std::vector<SE3>& poses) const {
  const PoseMatrices matrices(poses);
  constexpr std::size_t kChunk = 64;  // planes
  std::vector<Factor> factors(problem_.planes.size());
  ParallelChunks(factors.size(), kChunk, [&](std::size_t begin, std::size_t end) {
    for (std::size_t p = begin; p < end; ++p) {
      const Plane& plane = problem_.planes[p];
      Matrix4d Q = fixed_[p];
      for (int i = plane.first; i < plane.first + plane.count; ++i) {
        const auto k =
            static_cast<std::size_t>(problem_.observations[static_cast<std::size_t>(i)].frame);
        const Matrix4d T = Homogeneous(matrices.R[k], matrices.t[k]);
        Q.noalias() += T * S_[static_cast<std::size_t>(i)] * T.transpose();
      }
      const Eigen::SelfAdjointEigenSolver<Matrix4d> eigen(Q);
      factors[p] = {std::max(0.0, eigen.eigenvalues()(0)), eigen.eigenvectors().col(0)};
    }
  });
  return factors;
}

void EigenFactorsCost::Linearise(const std::vector<SE3>& poses, ReducedSystem* system) {
  held_ = Factors(poses);
  const PoseMatrices matrices(poses);
  system->cost = PassOverFrames(
      problem_, index_, matrices, false,
      [&](const FramePassItem& item) {
        const Eigen::Vector4d& pi = held_[item.plane_index].pi;
        const Eigen::Vector4d y = PlaneInFrame(pi, item.R, item.t);
        const Matrix4d& root = roots_[item.observation];
        const Eigen::Matrix<double, 4, 6> J = root * PlaneByPose(pi, y);
        const Eigen::Vector4d r = root * y;
        item.D->noalias() += item.plane.weight * (J.transpose() * J);
        item.g->noalias() += item.plane.weight * (J.transpose() * r);
        *item.cost += 0.5 * item.plane.weight * r.squaredNorm();
      },
      system);
}

double EigenFactorsCost::Value(const std::vector<SE3>& poses) const {
  return SumOfSquares(
      problem_, PoseMatrices(poses),
      [&](std::size_t p, std::size_t o, const Eigen::Matrix3d& R, const Eigen::Vector3d& t) {
        return (roots_[o] * PlaneInFrame(held_[p].pi, R, t)).squaredNorm();
      });
}

double EigenFactorsCost::ValueAndGradient(const std::vector<SE3>& poses,
                                          Eigen::VectorXd* gradient) const {
  const std::vector<Factor> factors = Factors(poses);
  double cost = 0.0;
  for (std::size_t p = 0; p < factors.size(); ++p) {
    cost += 0.5 * problem_.planes[p].weight * factors[p].lambda;
  }
  if (gradient == nullptr) return cost;
  ReducedSystem system;
  PassOverFrames(
      problem_, index_, PoseMatrices(poses), false,
      [&](const FramePassItem& item) {
        const Eigen::Vector4d& pi = factors[item.plane_index].pi;
        const Eigen::Vector4d y = PlaneInFrame(pi, item.R, item.t);
        *item.g += item.plane.weight * PlaneByPose(pi, y).transpose() * (S_[item.observation] * y);
      },
      &system);
  *gradient = std::move(system.gradient);
  return cost;
}

const Formulation& EigenFactorsLmFormulation() {
  static constexpr Formulation kFormulation = {
      "eigen_factors_lm",        "Eigen-Factors, least squares", "Ferrer 2019",
      /*needs_points=*/false,
      /*takes_priors=*/false,
      /*converges_slowly=*/true, MakeCost<EigenFactorsCost>};
  return kFormulation;
}

}  // namespace lamina
