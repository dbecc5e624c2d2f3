#include "backend/bundle/solver/trust_region.h"

#include <algorithm>
#include <cmath>

#include "core/base/stopwatch.h"

namespace lamina {
namespace {

constexpr double kMinGain = 1e-3;
constexpr double kStartRadius = 1e4, kMinRadius = 1e-32, kMaxRadius = 1e16;
constexpr double kMinStep = 1e-11;   // rad or m: the poses' own digits
constexpr double kRounding = 4e-16;  // of the cost
// H is kept after a step that is smaller than this, rad or m, and has brought what was promised.
constexpr double kKeepStep = 0.02, kKeepGain = 0.5;
// A solve that ends where a step lowers the cost by less than this share needs few steps more, and
// none of the digits that a fresh H brings: one of a small system is kept, too.
constexpr double kCoarseEnd = 5e-6;

std::vector<SE3> Moved(const std::vector<SE3>& poses, const Eigen::VectorXd& step) {
  std::vector<SE3> moved;
  moved.reserve(poses.size());
  for (std::size_t k = 0; k < poses.size(); ++k) {
    moved.push_back(Retract(poses[k], step.segment<6>(static_cast<Eigen::Index>(6 * k))));
  }
  return moved;
}

// Radius of the trust region (see the header).
class TrustRegion {
 public:
  double radius() const { return radius_; }
  void Accept(double gain) {
    radius_ =
        std::min(kMaxRadius, radius_ / std::max(1.0 / 3.0, 1.0 - std::pow(2.0 * gain - 1.0, 3)));
    shrink_ = 2.0;
  }
  // False if there is nothing left to try.
  bool Reject() {
    radius_ /= shrink_;
    shrink_ *= 2.0;
    return radius_ > kMinRadius;
  }

 private:
  double radius_ = kStartRadius;
  double shrink_ = 2.0;
};

}  // namespace

Eigen::VectorXd DampingScale(const Eigen::VectorXd& diagonal) {
  constexpr double kLeast = 1e-9;  // of the largest
  const Eigen::VectorXd size = diagonal.cwiseAbs();
  return size.cwiseMax(kLeast * size.maxCoeff() + 1e-300);
}

double PromisedDecrease(const Eigen::VectorXd& gradient, const Eigen::VectorXd& step,
                        const Eigen::VectorXd& damping) {
  return -0.5 * gradient.dot(step) + 0.5 * step.cwiseAbs2().dot(damping);
}

BundleResult MinimiseInTrustRegion(const std::vector<SE3>& poses,
                                   const BundleAdjusterOptions& options,
                                   const BundleObserver& observer, bool may_keep,
                                   StepModel* model) {
  Stopwatch clock;
  BundleResult result;
  result.poses = poses;
  result.status = BundleResult::Status::kFailed;  // until a step could be solved for
  if (!model->Linearise(result.poses)) return result;
  result.initial_cost = result.final_cost = model->value();
  TrustRegion region;
  bool done = false;
  while (!done && result.iterations < options.max_iterations) {
    BundleStep step;
    step.iteration = ++result.iterations;
    Eigen::VectorXd delta;
    double promised = 0.0;
    bool stale = false;
    if (model->Solve(region.radius(), &delta, &promised)) {
      result.status = BundleResult::Status::kIterationLimit;
      step.step = delta.cwiseAbs().maxCoeff();
      const std::vector<SE3> moved = Moved(result.poses, delta);
      const double before = model->value();
      const double decrease = before - model->Value(moved);
      done = step.step < kMinStep || promised <= kRounding * before;
      step.accepted = decrease > kMinGain * promised;  // false for NaN
      if (step.accepted) {
        result.poses = moved;
        const double gain = decrease / promised;
        region.Accept(gain);
        done = done || decrease <= options.min_cost_change * before;
        result.final_cost = before - decrease;
        if (!done && result.iterations < options.max_iterations) {
          const bool keep = may_keep && model->large(options.min_cost_change >= kCoarseEnd) &&
                            step.step < kKeepStep && gain > kKeepGain;
          if (!(keep && model->LineariseKeeping(result.poses, delta)) &&
              !model->Linearise(result.poses)) {
            break;
          }
          result.final_cost = model->value();
        }
      } else if (model->kept() && !done) {
        // H was too old for this step: a fresh one decides.
        if (!model->Linearise(result.poses)) break;
        stale = true;
      }
    }
    if (done) result.status = BundleResult::Status::kConverged;
    if (!step.accepted && !stale && !region.Reject()) break;
    step.cost = result.final_cost;
    step.solve_ms = clock.Milliseconds();
    if (observer) clock.Outside([&] { observer(step, result.poses); });
  }
  result.solve_ms = clock.Milliseconds();
  return result;
}

}  // namespace lamina
