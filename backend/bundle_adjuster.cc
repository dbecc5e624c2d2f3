#include "backend/bundle_adjuster.h"

#include <ceres/ceres.h>

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <array>
#include <cmath>

#include "backend/condensed_cost.h"

namespace lamina {
namespace {

constexpr int kAmbient = 7;  // Eigen's quaternion order x y z w, then the translation

using PoseBlock = std::array<double, kAmbient>;

PoseBlock ToBlock(const SE3& T) {
  return {T.q.x(), T.q.y(), T.q.z(), T.q.w(), T.t.x(), T.t.y(), T.t.z()};
}

SE3 FromBlock(const double* x) {
  return SE3(Eigen::Quaterniond(x[3], x[0], x[1], x[2]), Eigen::Vector3d(x[4], x[5], x[6]));
}

// d(x y z w of q Exp(w)) / dw at w = 0. Its columns are orthogonal with squared norm 1/4.
Eigen::Matrix<double, 4, 3> QuaternionJacobian(const double* x) {
  Eigen::Matrix<double, 4, 3> j;
  j << x[3], -x[2], x[1],  //
      x[2], x[3], -x[0],   //
      -x[1], x[0], x[3],   //
      -x[0], -x[1], -x[2];
  return 0.5 * j;
}

// The perturbation of core/se3.h as a Ceres manifold.
class PoseManifold final : public ceres::Manifold {
 public:
  int AmbientSize() const override { return kAmbient; }
  int TangentSize() const override { return 6; }

  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override {
    const PoseBlock moved = ToBlock(Retract(FromBlock(x), Eigen::Map<const Vector6d>(delta)));
    std::copy(moved.begin(), moved.end(), x_plus_delta);
    return true;
  }
  bool PlusJacobian(const double* x, double* jacobian) const override {
    Eigen::Map<Eigen::Matrix<double, 7, 6, Eigen::RowMajor>> j(jacobian);
    j.setZero();
    j.topLeftCorner<4, 3>() = QuaternionJacobian(x);
    j.bottomRightCorner<3, 3>().setIdentity();
    return true;
  }
  bool Minus(const double* y, const double* x, double* y_minus_x) const override {
    Eigen::Map<Vector6d> delta(y_minus_x);
    delta = LocalDelta(FromBlock(x), FromBlock(y));
    return true;
  }
  bool MinusJacobian(const double* x, double* jacobian) const override {
    Eigen::Map<Eigen::Matrix<double, 6, 7, Eigen::RowMajor>> j(jacobian);
    j.setZero();
    j.topLeftCorner<3, 4>() = 4.0 * QuaternionJacobian(x).transpose();
    j.bottomRightCorner<3, 3>().setIdentity();
    return true;
  }
};

// Writes tangent_jacobian (rows x 6) to the ambient block (rows x 7) such that the manifold's
// PlusJacobian gives it back: multiply by MinusJacobian, its left inverse.
template <typename Derived>
void WriteJacobian(const Eigen::MatrixBase<Derived>& tangent_jacobian, const double* x,
                   double* jacobian) {
  Eigen::Matrix<double, 6, 7, Eigen::RowMajor> minus;
  PoseManifold().MinusJacobian(x, minus.data());
  Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, 7, Eigen::RowMajor>> out(
      jacobian, tangent_jacobian.rows(), 7);
  out.noalias() = tangent_jacobian * minus;
}

class WindowCost final : public ceres::CostFunction {
 public:
  explicit WindowCost(const BundleProblem& problem)
      : cost_(problem), size_(static_cast<int>(problem.poses.size())) {
    set_num_residuals(6 * size_ + 1);
    mutable_parameter_block_sizes()->assign(problem.poses.size(), kAmbient);
  }

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    std::vector<SE3> poses;
    for (int k = 0; k < size_; ++k) poses.push_back(FromBlock(parameters[k]));
    Eigen::Map<Eigen::VectorXd> r(residuals, 6 * size_ + 1);
    r.setZero();
    if (jacobians == nullptr) {
      r(6 * size_) = std::sqrt(2.0 * cost_.Value(poses));
      return true;
    }
    Eigen::VectorXd g;
    Eigen::MatrixXd H;
    const double cost = cost_.Linearise(poses, &g, &H);
    if (!std::isfinite(cost) || !H.allFinite()) return false;
    const Eigen::MatrixXd A = SquareRoot(&H);
    r.head(6 * size_) = SolveTransposed(A, g);
    r(6 * size_) = std::sqrt(std::max(0.0, 2.0 * cost - r.head(6 * size_).squaredNorm()));
    Eigen::MatrixXd rows = Eigen::MatrixXd::Zero(6 * size_ + 1, 6);
    for (int k = 0; k < size_; ++k) {
      if (jacobians[k] == nullptr) continue;
      rows.topRows(6 * size_) = A.middleCols(6 * k, 6);
      WriteJacobian(rows, parameters[k], jacobians[k]);
    }
    return true;
  }

 private:
  // Upper triangular A with A'A = H. What the planes leave open (H singular) gets a stiffness that
  // is negligible beside any measurement but keeps the factorisation alive.
  static Eigen::MatrixXd SquareRoot(Eigen::MatrixXd* H) {
    const double tiny = 1e-10 * (H->diagonal().maxCoeff() + 1e-300);
    H->diagonal().array() += tiny;
    Eigen::LLT<Eigen::MatrixXd> llt(*H);
    for (double more = tiny; llt.info() != Eigen::Success; more *= 100.0) {
      H->diagonal().array() += more;
      llt.compute(*H);
    }
    return llt.matrixU();
  }
  static Eigen::VectorXd SolveTransposed(const Eigen::MatrixXd& A, const Eigen::VectorXd& g) {
    return A.transpose().triangularView<Eigen::Lower>().solve(g);
  }

  CondensedCost cost_;
  int size_;
};

// sqrt_information * LocalDelta(T_a_b, T_world_a^-1 T_world_b). The Jacobians neglect the curvature
// of Log, which is second order in the (small) residual.
class RelativePriorCost final : public ceres::SizedCostFunction<6, kAmbient, kAmbient> {
 public:
  explicit RelativePriorCost(const RelativePrior& prior) : prior_(prior) {}

  bool Evaluate(double const* const* parameters, double* residuals,
                double** jacobians) const override {
    const SE3 a = FromBlock(parameters[0]);
    const SE3 b = FromBlock(parameters[1]);
    const SE3 T_a_b = a.Inverse() * b;
    Eigen::Map<Vector6d> r(residuals);
    r = prior_.sqrt_information * LocalDelta(prior_.T_a_b, T_a_b);
    if (jacobians == nullptr) return true;
    const Eigen::Matrix3d Rt = a.R().transpose();
    if (jacobians[0] != nullptr) {
      Matrix6d J = Matrix6d::Zero();
      J.topLeftCorner<3, 3>() = -T_a_b.R().transpose();
      J.bottomLeftCorner<3, 3>() = Hat(T_a_b.t);
      J.bottomRightCorner<3, 3>() = -Rt;
      WriteJacobian(Matrix6d(prior_.sqrt_information * J), parameters[0], jacobians[0]);
    }
    if (jacobians[1] != nullptr) {
      Matrix6d J = Matrix6d::Zero();
      J.topLeftCorner<3, 3>().setIdentity();
      J.bottomRightCorner<3, 3>() = Rt;
      WriteJacobian(Matrix6d(prior_.sqrt_information * J), parameters[1], jacobians[1]);
    }
    return true;
  }

 private:
  RelativePrior prior_;
};

}  // namespace

void BundleAdjusterOptions::Visit(OptionVisitor& v) {
  v.Integer("max_iterations", &max_iterations, 1, 1000);
  v.Number("min_cost_change", &min_cost_change, 0.0, 1.0);
  v.Integer("min_planes", &min_planes, 3, 1000000);
}

BundleResult AdjustBundle(const BundleProblem& problem, const BundleAdjusterOptions& options) {
  CheckOptions(options, "backend.solver");
  BundleResult result;
  result.poses = problem.poses;
  if (problem.poses.size() < 2 ||
      problem.planes.size() < static_cast<std::size_t>(options.min_planes)) {
    return result;
  }
  // Ceres ends the process over a parameter block that is not finite.
  for (const SE3& T : problem.poses) {
    if (T.q.coeffs().allFinite() && T.t.allFinite()) continue;
    result.status = BundleResult::Status::kFailed;
    return result;
  }
  std::vector<PoseBlock> blocks;
  for (const SE3& T : problem.poses) blocks.push_back(ToBlock(T));
  std::vector<double*> parameters;
  for (PoseBlock& block : blocks) parameters.push_back(block.data());

  ceres::Problem::Options problem_options;
  problem_options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  PoseManifold manifold;
  ceres::Problem ceres_problem(problem_options);
  for (double* block : parameters) ceres_problem.AddParameterBlock(block, kAmbient, &manifold);
  ceres_problem.AddResidualBlock(new WindowCost(problem), nullptr, parameters);
  for (const RelativePrior& prior : problem.priors) {
    ceres_problem.AddResidualBlock(new RelativePriorCost(prior), nullptr,
                                   parameters[static_cast<std::size_t>(prior.a)],
                                   parameters[static_cast<std::size_t>(prior.b)]);
  }
  if (problem.hold_first_pose) ceres_problem.SetParameterBlockConstant(parameters[0]);

  ceres::Solver::Options solver;
  solver.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
  solver.max_num_iterations = options.max_iterations;
  solver.function_tolerance = options.min_cost_change;
  solver.num_threads = 1;  // the one residual block is parallel inside
  solver.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(solver, &ceres_problem, &summary);

  result.initial_cost = summary.initial_cost;
  result.final_cost = summary.final_cost;
  result.iterations = summary.num_successful_steps + summary.num_unsuccessful_steps;
  if (!summary.IsSolutionUsable()) {
    result.status = BundleResult::Status::kFailed;
    return result;
  }
  result.status = summary.termination_type == ceres::CONVERGENCE
                      ? BundleResult::Status::kConverged
                      : BundleResult::Status::kIterationLimit;
  for (std::size_t k = 0; k < blocks.size(); ++k) result.poses[k] = FromBlock(blocks[k].data());
  return result;
}

}  // namespace lamina
