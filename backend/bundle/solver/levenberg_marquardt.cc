#include "backend/bundle/solver/levenberg_marquardt.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "backend/bundle/solver/held_directions.h"
#include "backend/bundle/solver/priors.h"
#include "backend/bundle/solver/sparse_cholesky.h"
#include "backend/bundle/solver/trust_region.h"

namespace lamina {
namespace {

// The quadratic model at one linearisation, and its damped solutions.
class StepSolver final : public StepModel {
 public:
  StepSolver(const BundleProblem& problem, BundleCost* cost)
      : problem_(problem), index_(problem), pattern_(problem, index_), held_(problem), cost_(cost) {
    const auto size = static_cast<Eigen::Index>(6 * problem.poses.size());
    sparse_ = size >= kSparseSize && pattern_.Density() < kSparseDensity &&
              cholesky_.Order(pattern_) < kSparseShare;
    in_parts_ = sparse_ && cost->MakesRows() && problem.observations.size() > ReducedSystem::kPart;
  }

  // False if anything is not finite.
  bool Linearise(const std::vector<SE3>& poses) override {
    kept_.clear();
    LineariseCost(poses);
    value_ = system_.cost;
    decoupled_ = !in_parts_ && system_.rows.empty() && problem_.priors.empty();
    const auto size = system_.gradient.size();
    diagonal_.resize(size);
    if (decoupled_) {
      held_.TakeOut(&system_.diagonal);
      for (Eigen::Index i = 0; i < size; ++i) {
        diagonal_(i) = system_.diagonal[static_cast<std::size_t>(i / 6)](i % 6, i % 6);
      }
    } else if (sparse_) {
      if (in_parts_) {
        system_.AssembleInParts(problem_, index_, pattern_, *cost_, ReducedSystem::kPart,
                                &sparse_H_);
      } else {
        system_.Assemble(problem_, index_, pattern_, &sparse_H_);
      }
      value_ += AddPriors(problem_, poses, &system_.gradient, &sparse_H_);
      held_.TakeOut(pattern_, &sparse_H_);
      diagonal_ = sparse_H_.diagonal();
    } else {
      system_.Assemble(problem_, index_, &H_);
      value_ += AddPriors(problem_, poses, &system_.gradient, &H_);
      held_.TakeOut(&H_);
      diagonal_ = H_.diagonal();
    }
    held_.Project(&system_.gradient);
    diagonal_ = DampingScale(diagonal_);
    return std::isfinite(value_) && system_.gradient.allFinite() && diagonal_.allFinite();
  }

  // Whether assembling and factorising H takes most of a step, or, if `coarse`, at least much of
  // it.
  bool large(bool coarse) const override {
    return !decoupled_ && system_.gradient.size() >= (coarse ? kWindowSize : kLargeSize);
  }
  // Cost and gradient at these poses, which `step` has led to; H is that of before, corrected by
  // how the gradient has changed (see the header). False if anything is not finite.
  bool LineariseKeeping(const std::vector<SE3>& poses, const Eigen::VectorXd& step) override {
    const Eigen::VectorXd before = system_.gradient;
    cost_->FindGradient(poses, &system_);
    value_ = system_.cost + AddPriorGradient(problem_, poses, &system_.gradient);
    held_.Project(&system_.gradient);
    kept_.push_back({step, system_.gradient - before});
    return std::isfinite(value_) && system_.gradient.allFinite() &&
           kept_.back().step.dot(kept_.back().change) > 0.0;
  }
  // Whether H is one of before.
  bool kept() const override { return !kept_.empty(); }

  double value() const override { return value_; }
  double Value(const std::vector<SE3>& poses) const override {
    return cost_->Value(poses) + PriorCost(problem_, poses);
  }

  // False if the damped matrix is not positive definite. `promised` is the model's decrease.
  bool Solve(double radius, Eigen::VectorXd* step, double* promised) override {
    step->setZero(system_.gradient.size());
    Eigen::VectorXd damping = Eigen::VectorXd::Zero(step->size());
    if (kept()) {
      *step = SolveKept();
    } else {
      damping = diagonal_ / radius;
      const bool ready = decoupled_ ? SolveBlocks(damping, step)
                         : sparse_ ? cholesky_.FactoriseDamped(pattern_, held_, damping, &sparse_H_)
                                   : FactoriseDense(damping);
      if (!ready) return false;
      if (!decoupled_) *step = -SolveFactor(system_.gradient);
    }
    if (!step->allFinite()) return false;
    *promised = PromisedDecrease(system_.gradient, *step, damping);
    return true;
  }

 private:
  void LineariseCost(const std::vector<SE3>& poses) {
    if (in_parts_) {
      cost_->LineariseWithoutRows(poses, &system_);
    } else {
      cost_->Linearise(poses, &system_);
    }
  }

  bool SolveBlocks(const Eigen::VectorXd& damping, Eigen::VectorXd* step) const {
    std::vector<Matrix6d> damped = system_.diagonal;
    held_.ForEachDamping(damping,
                         [&](std::size_t k, const Matrix6d& change) { damped[k] += change; });
    for (Eigen::Index i = 0; i < step->size(); i += 6) {
      Matrix6d& block = damped[static_cast<std::size_t>(i / 6)];
      block.diagonal() += damping.segment<6>(i);
      const Eigen::LLT<Matrix6d> llt(block);
      if (llt.info() != Eigen::Success) return false;
      step->segment<6>(i) = -llt.solve(system_.gradient.segment<6>(i));
    }
    return true;
  }

  bool FactoriseDense(const Eigen::VectorXd& damping) {
    factor_ = H_;
    factor_.diagonal() += damping;
    held_.ForEachDamping(damping, [&](std::size_t k, const Matrix6d& change) {
      const auto i = static_cast<Eigen::Index>(6 * k);
      factor_.block<6, 6>(i, i) += change;
    });
    return Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>>(factor_).info() == Eigen::Success;
  }

  Eigen::VectorXd SolveFactor(const Eigen::VectorXd& right_side) {
    if (sparse_) return cholesky_.Solve(right_side);
    Eigen::VectorXd x = right_side;
    factor_.triangularView<Eigen::Lower>().solveInPlace(x);
    factor_.triangularView<Eigen::Lower>().adjoint().solveInPlace(x);
    return x;
  }

  // -B^-1 g, B being H with the secant corrections of BFGS: the two-loop recursion.
  Eigen::VectorXd SolveKept() {
    Eigen::VectorXd x = system_.gradient;
    std::vector<double> along(kept_.size());
    for (std::size_t i = kept_.size(); i-- > 0;) {
      along[i] = kept_[i].step.dot(x) / kept_[i].step.dot(kept_[i].change);
      x -= along[i] * kept_[i].change;
    }
    x = SolveFactor(x);
    for (std::size_t i = 0; i < kept_.size(); ++i) {
      const Secant& k = kept_[i];
      x += (along[i] - k.change.dot(x) / k.step.dot(k.change)) * k.step;
    }
    return -x;
  }

  // Below this size, with more of its blocks filled, or where a factorisation saves less, the dense
  // one is faster.
  static constexpr Eigen::Index kSparseSize = 300;
  static constexpr double kSparseDensity = 0.7, kSparseShare = 0.6;
  static constexpr Eigen::Index kLargeSize = 300, kWindowSize = 60;

  const BundleProblem& problem_;
  BundleIndex index_;
  BlockPattern pattern_;
  HeldDirections held_;
  BundleCost* cost_;
  ReducedSystem system_;
  bool decoupled_ = false;
  struct Secant {
    Eigen::VectorXd step, change;  // of the gradient
  };
  std::vector<Secant> kept_;  // since H was made
  double value_ = 0.0;
  Eigen::MatrixXd H_, factor_;
  bool sparse_ = false;
  bool in_parts_ = false;  // H is assembled from the rows of some planes at a time
  SparseCholesky cholesky_;
  Eigen::SparseMatrix<double> sparse_H_;
  Eigen::VectorXd diagonal_;
};

}  // namespace

BundleResult MinimiseByLevenbergMarquardt(const BundleProblem& problem, BundleCost* cost,
                                          const BundleAdjusterOptions& options,
                                          const BundleObserver& observer, bool may_keep) {
  StepSolver solver(problem, cost);
  return MinimiseInTrustRegion(problem.poses, options, observer, may_keep, &solver);
}

}  // namespace lamina
