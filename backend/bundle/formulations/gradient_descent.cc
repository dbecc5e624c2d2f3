#include "backend/bundle/formulations/gradient_descent.h"

#include <algorithm>
#include <cmath>

#include "backend/bundle/solver/held_directions.h"
#include "core/base/stopwatch.h"

namespace lamina {
namespace {

using Poses = std::vector<SE3>;

// Tangent vectors scaled so that a component is in metres, whichever it is.
class ScaledTangent {
 public:
  explicit ScaledTangent(const BundleProblem& problem) {
    double sum = 0.0, count = 0.0;
    for (const PlaneObservation& o : problem.observations) {
      sum += o.cluster.scatter.Trace() + o.cluster.count * o.cluster.mean.squaredNorm();
      count += o.cluster.count;
    }
    if (sum > 0.0) arm_m_ = std::sqrt(sum / count);
    Vector6d scale = Vector6d::Ones();
    scale.head<3>() /= arm_m_;
    held_ = HeldSpaces(problem, scale);
  }
  // The gradient by the scaled tangent, without the held directions.
  void Scale(Eigen::VectorXd* gradient) const {
    for (Eigen::Index i = 0; i < gradient->size(); i += 6) gradient->segment<3>(i) /= arm_m_;
    for (std::size_t k = 0; k < held_.size(); ++k) {
      auto part = gradient->segment<6>(static_cast<Eigen::Index>(6 * k));
      if (held_[k].cols() == 6) part.setZero();
      if (held_[k].cols() > 0) part -= held_[k] * (held_[k].transpose() * part);
    }
  }
  Poses Retract(const Poses& poses, const Eigen::VectorXd& step) const {
    Poses moved;
    moved.reserve(poses.size());
    for (std::size_t k = 0; k < poses.size(); ++k) {
      Vector6d delta = step.segment<6>(static_cast<Eigen::Index>(6 * k));
      delta.head<3>() /= arm_m_;
      moved.push_back(lamina::Retract(poses[k], delta));
    }
    return moved;
  }
  Eigen::VectorXd Difference(const Poses& from, const Poses& to) const {
    Eigen::VectorXd step(static_cast<Eigen::Index>(6 * from.size()));
    for (std::size_t k = 0; k < from.size(); ++k) {
      Vector6d delta = LocalDelta(from[k], to[k]);
      delta.head<3>() *= arm_m_;
      step.segment<6>(static_cast<Eigen::Index>(6 * k)) = delta;
    }
    return step;
  }

 private:
  double arm_m_ = 1.0;
  std::vector<HeldSpace> held_;
};

}  // namespace

BundleResult DescendEigenFactors(const BundleProblem& problem, const BundleAdjusterOptions& options,
                                 const BundleObserver& observer) {
  constexpr double kMinStep = 1e-11, kShortest = 1e-30;
  Stopwatch clock;
  BundleResult result;
  result.poses = problem.poses;
  const EigenFactorsCost cost(problem);
  const ScaledTangent tangent(problem);
  Eigen::VectorXd gradient;
  Poses ahead = result.poses;  // where the gradient is taken
  double value_ahead = cost.ValueAndGradient(ahead, &gradient);
  result.initial_cost = result.final_cost = value_ahead;
  result.status = BundleResult::Status::kFailed;
  if (!std::isfinite(value_ahead) || !gradient.allFinite()) return result;
  tangent.Scale(&gradient);
  result.status = BundleResult::Status::kIterationLimit;
  double length = 1e-3 / std::max(1e-300, gradient.cwiseAbs().maxCoeff());
  double momentum = 1.0;
  bool done = false;
  while (!done && result.iterations < options.max_iterations) {
    BundleStep step;
    step.iteration = ++result.iterations;
    const Poses next = tangent.Retract(ahead, -length * gradient);
    const double value = cost.ValueAndGradient(next, nullptr);
    const double square = gradient.squaredNorm();
    step.step = length * gradient.cwiseAbs().maxCoeff();
    if (!(value <= value_ahead - 0.5 * length * square)) {  // true for NaN, too
      length *= 0.5;
      done = length * std::sqrt(square) < kMinStep || length < kShortest;
    } else if (value > result.final_cost) {
      // Momentum has carried too far: start again from the best.
      momentum = 1.0;
      ahead = result.poses;
      value_ahead = cost.ValueAndGradient(ahead, &gradient);
      tangent.Scale(&gradient);
    } else {
      step.accepted = true;
      const double decrease = result.final_cost - value;
      const double grown = 0.5 * (1.0 + std::sqrt(1.0 + 4.0 * momentum * momentum));
      const double carry = (momentum - 1.0) / grown;
      momentum = grown;
      ahead = tangent.Retract(next, carry * tangent.Difference(result.poses, next));
      done = decrease <= options.min_cost_change * result.final_cost || step.step < kMinStep;
      result.poses = next;
      result.final_cost = value;
      value_ahead = cost.ValueAndGradient(ahead, &gradient);
      tangent.Scale(&gradient);
      length *= 1.1;
    }
    if (done) result.status = BundleResult::Status::kConverged;
    step.cost = result.final_cost;
    step.solve_ms = clock.Milliseconds();
    if (observer) clock.Outside([&] { observer(step, result.poses); });
  }
  result.solve_ms = clock.Milliseconds();
  return result;
}

const Formulation& EigenFactorsFormulation() {
  static constexpr Formulation kFormulation = {
      "eigen_factors",           "Eigen-Factors", "Ferrer 2019",
      /*needs_points=*/false,
      /*takes_priors=*/false,
      /*converges_slowly=*/true, nullptr,         DescendEigenFactors};
  return kFormulation;
}

}  // namespace lamina
