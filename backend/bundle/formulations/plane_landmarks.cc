#include "backend/bundle/formulations/plane_landmarks.h"

#include <ceres/ceres.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "backend/bundle/plane_geometry.h"
#include "backend/bundle/solver/held_directions.h"
#include "core/base/stopwatch.h"

namespace lamina {
namespace {

constexpr int kPoseSize = 7;  // Eigen's quaternion order x y z w, then the translation
using PoseBlock = std::array<double, kPoseSize>;

PoseBlock ToBlock(const SE3& T) {
  return {T.q.x(), T.q.y(), T.q.z(), T.q.w(), T.t.x(), T.t.y(), T.t.z()};
}

SE3 FromBlock(const PoseBlock& x) {
  return SE3(Eigen::Quaterniond(x[3], x[0], x[1], x[2]), Eigen::Vector3d(x[4], x[5], x[6]));
}

// A plane as one frame's cluster measures it: Pi_k relative to an anchor one metre behind the
// cluster, in the LiDAR frame.
struct PlaneMeasurement {
  PlaneMeasurement(const PointCluster& cluster, double weight) {
    const Eigen3 eigen = cluster.EigenPairs();
    anchor = cluster.mean - eigen.u.col(2);
    closest = eigen.u.col(2);
    const Eigen::Vector3d information(std::max(0.0, eigen.l(0)), std::max(0.0, eigen.l(1)), 1.0);
    root = (weight * cluster.count * information).cwiseSqrt().asDiagonal() * eigen.u.transpose();
  }
  // A fitted normal has no sign of its own.
  void Reverse() {
    anchor += 2.0 * closest;
    closest = -closest;
  }

  Eigen::Vector3d anchor, closest;
  Eigen::Matrix3d root;  // of the information
};

// By hand: there are as many of these as observations, and automatic derivatives take most of the
// time of a solve.
class PlaneResidual final : public ceres::SizedCostFunction<3, kPoseSize, 3> {
 public:
  PlaneResidual(const PlaneMeasurement& measured, const Eigen::Vector3d& world_anchor)
      : measured_(measured), world_anchor_(world_anchor) {}

  bool Evaluate(const double* const* parameters, double* residual,
                double** jacobians) const override {
    const Eigen::Map<const Eigen::Quaterniond> q(parameters[0]);
    const Eigen::Map<const Eigen::Vector3d> t(parameters[0] + 4), closest(parameters[1]);
    const Eigen::Matrix3d R = q.toRotationMatrix();
    const double d = closest.norm();
    const Eigen::Vector3d normal = closest / d;
    const Eigen::Vector3d arm = R * measured_.anchor;
    const Eigen::Vector3d from_anchor = arm + t - world_anchor_;
    // Of the plane from the measurement's anchor, along the normal.
    const double distance = d - normal.dot(from_anchor);
    const Eigen::Vector3d direction = R.transpose() * normal;
    Eigen::Map<Eigen::Vector3d> difference(residual);
    difference = measured_.root * (direction * distance - measured_.closest);
    if (jacobians == nullptr) return true;
    if (jacobians[0] != nullptr) {
      // By w in R <- Exp(2 w) R, which is how the manifold turns; P, its plus at zero, takes this
      // to the four numbers, and as P' P = 1, the manifold takes it back.
      const Eigen::Matrix3d by_turn = 2.0 * (distance * R.transpose() * Hat(normal) +
                                             direction * normal.cross(arm).transpose());
      Eigen::Matrix<double, 4, 3> P;
      P << q.w() * Eigen::Matrix3d::Identity() - Hat(q.vec()), -q.vec().transpose();
      Eigen::Map<Eigen::Matrix<double, 3, kPoseSize, Eigen::RowMajor>> J(jacobians[0]);
      J.leftCols<4>().noalias() = measured_.root * by_turn * P.transpose();
      J.rightCols<3>().noalias() = -(measured_.root * direction) * normal.transpose();
    }
    if (jacobians[1] != nullptr) {
      const Eigen::Matrix3d normal_by =
          (Eigen::Matrix3d::Identity() - normal * normal.transpose()) / d;
      const Eigen::Vector3d distance_by = normal - normal_by * from_anchor;
      Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>> J(jacobians[1]);
      J.noalias() = measured_.root *
                    (distance * R.transpose() * normal_by + direction * distance_by.transpose());
    }
    return true;
  }

 private:
  PlaneMeasurement measured_;
  Eigen::Vector3d world_anchor_;
};

// Motion along one direction since the start, with a stiffness beside which planes are nothing.
struct HoldResidual {
  template <typename T>
  bool operator()(const T* pose, T* residual) const {
    constexpr double kStiffness = 1e6;
    const Eigen::Map<const Eigen::Quaternion<T>> q(pose);
    const Eigen::Map<const Eigen::Matrix<T, 3, 1>> t(pose + 4);
    const Eigen::Quaternion<T> turned = start.q.conjugate().cast<T>() * q;
    const Eigen::Matrix<T, 3, 1> moved = t - start.t.cast<T>();
    *residual = kStiffness * (T(2.0) * direction.head<3>().cast<T>().dot(turned.vec()) +
                              direction.tail<3>().cast<T>().dot(moved));
    return true;
  }
  SE3 start;
  Vector6d direction;
};

// The direction that the clusters' own normals have in common: from poor start values the aggregate
// is thick, and its smallest eigenvector points anywhere.
Eigen::Vector3d MeanNormal(const BundleProblem& problem, const Plane& plane,
                           const Eigen::Vector3d& fallback) {
  Symmetric3 outer;
  for (int i = plane.first; i < plane.first + plane.count; ++i) {
    const PlaneObservation& o = problem.observations[static_cast<std::size_t>(i)];
    outer.AddOuter(o.cluster.count, problem.poses[static_cast<std::size_t>(o.frame)].q *
                                        o.cluster.EigenPairs().u.col(2));
  }
  return plane.count > 0 ? Eigen::Vector3d(EigenDecompose(outer).u.col(0)) : fallback;
}

// Hands Ceres' iterations on.
class Callback final : public ceres::IterationCallback {
 public:
  Callback(const std::vector<PoseBlock>& blocks, const BundleObserver& observer, Stopwatch* clock)
      : blocks_(blocks), observer_(observer), clock_(clock) {}

  ceres::CallbackReturnType operator()(const ceres::IterationSummary& summary) override {
    if (summary.iteration == 0 || !observer_) return ceres::SOLVER_CONTINUE;
    BundleStep step;
    step.iteration = summary.iteration;
    step.accepted = summary.step_is_successful;
    step.cost = summary.cost;
    step.step = summary.step_norm;
    step.solve_ms = clock_->Milliseconds();
    clock_->Outside([&] {
      std::vector<SE3> poses;
      for (const PoseBlock& block : blocks_) poses.push_back(FromBlock(block));
      observer_(step, poses);
    });
    return ceres::SOLVER_CONTINUE;
  }

 private:
  const std::vector<PoseBlock>& blocks_;
  const BundleObserver& observer_;
  Stopwatch* clock_;
};

// The problem in Ceres' terms, and the memory of its parameters.
class LandmarkProblem {
 public:
  explicit LandmarkProblem(const BundleProblem& problem) : ceres_(Options()) {
    for (const SE3& T : problem.poses) blocks_.push_back(ToBlock(T));
    planes_.resize(problem.planes.size());
    for (PoseBlock& block : blocks_) ceres_.AddParameterBlock(block.data(), kPoseSize, &manifold_);
    Hold(problem);
    const std::vector<PlaneFrame> frames = MakePlaneFrames(problem, PoseMatrices(problem.poses));
    for (std::size_t p = 0; p < planes_.size(); ++p) AddPlane(problem, p, frames[p]);
  }

  ceres::Problem& ceres() { return ceres_; }
  const std::vector<PoseBlock>& blocks() const { return blocks_; }

  // Planes first, poses last: what the Schur solver eliminates.
  std::shared_ptr<ceres::ParameterBlockOrdering> Ordering() {
    auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    for (Eigen::Vector3d& plane : planes_) {
      if (ceres_.HasParameterBlock(plane.data())) ordering->AddElementToGroup(plane.data(), 0);
    }
    for (PoseBlock& block : blocks_) ordering->AddElementToGroup(block.data(), 1);
    if (ceres_.HasParameterBlock(standing_.data())) {
      ordering->AddElementToGroup(standing_.data(), 1);
    }
    return ordering;
  }

 private:
  static ceres::Problem::Options Options() {
    ceres::Problem::Options options;
    options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    return options;
  }

  void Hold(const BundleProblem& problem) {
    const std::vector<HeldSpace> held = HeldSpaces(problem);
    for (std::size_t k = 0; k < held.size(); ++k) {
      if (held[k].cols() == 6) {
        ceres_.SetParameterBlockConstant(blocks_[k].data());
        continue;
      }
      for (Eigen::Index i = 0; i < held[k].cols(); ++i) {
        ceres_.AddResidualBlock(new ceres::AutoDiffCostFunction<HoldResidual, 1, kPoseSize>(
                                    new HoldResidual{problem.poses[k], held[k].col(i)}),
                                nullptr, blocks_[k].data());
      }
    }
  }

  void AddPlane(const BundleProblem& problem, std::size_t p, const PlaneFrame& frame) {
    const Plane& plane = problem.planes[p];
    const Eigen::Vector3d normal = MeanNormal(problem, plane, frame.normal);
    planes_[p] = normal;
    const Eigen::Vector3d anchor = frame.mean - normal;
    const auto add = [&](const PointCluster& cluster, double* pose) {
      PlaneMeasurement measured(cluster, plane.weight);
      const Eigen::Map<const Eigen::Quaterniond> q(pose);
      if ((q * measured.closest).dot(normal) < 0.0) measured.Reverse();
      ceres_.AddResidualBlock(new PlaneResidual(measured, anchor), nullptr, pose,
                              planes_[p].data());
    };
    for (int i = plane.first; i < plane.first + plane.count; ++i) {
      const PlaneObservation& o = problem.observations[static_cast<std::size_t>(i)];
      add(o.cluster, blocks_[static_cast<std::size_t>(o.frame)].data());
    }
    if (plane.fixed.Empty()) return;
    if (!ceres_.HasParameterBlock(standing_.data())) {
      ceres_.AddParameterBlock(standing_.data(), kPoseSize, &manifold_);
      ceres_.SetParameterBlockConstant(standing_.data());
    }
    add(plane.fixed, standing_.data());
  }

  ceres::ProductManifold<ceres::EigenQuaternionManifold, ceres::EuclideanManifold<3>> manifold_;
  std::vector<PoseBlock> blocks_;
  PoseBlock standing_ = ToBlock(SE3());  // of fixed clusters
  std::vector<Eigen::Vector3d> planes_;
  ceres::Problem ceres_;  // last: it refers to all of the above
};

}  // namespace

BundleResult SolvePlaneLandmarks(const BundleProblem& problem, const BundleAdjusterOptions& options,
                                 const BundleObserver& observer) {
  Stopwatch clock;
  BundleResult result;
  result.poses = problem.poses;
  LandmarkProblem landmarks(problem);
  ceres::Solver::Options solver;
  solver.linear_solver_type = ceres::DENSE_SCHUR;
  solver.linear_solver_ordering = landmarks.Ordering();
  solver.max_num_iterations = options.max_iterations;
  solver.function_tolerance = options.min_cost_change;
  solver.gradient_tolerance = 1e-14;
  solver.parameter_tolerance = 1e-12;
  solver.num_threads = 1;  // sums over several threads would depend on their number
  solver.logging_type = ceres::SILENT;
  Callback callback(landmarks.blocks(), observer, &clock);
  solver.callbacks.push_back(&callback);
  solver.update_state_every_iteration = static_cast<bool>(observer);
  ceres::Solver::Summary summary;
  ceres::Solve(solver, &landmarks.ceres(), &summary);
  result.solve_ms = clock.Milliseconds();
  result.initial_cost = summary.initial_cost;
  result.final_cost = summary.final_cost;
  // Ceres' first entry is the start.
  result.iterations = std::max(0, static_cast<int>(summary.iterations.size()) - 1);
  if (!summary.IsSolutionUsable() || !std::isfinite(summary.final_cost)) {
    result.status = BundleResult::Status::kFailed;
    return result;
  }
  result.status = summary.termination_type == ceres::CONVERGENCE
                      ? BundleResult::Status::kConverged
                      : BundleResult::Status::kIterationLimit;
  for (std::size_t k = 0; k < result.poses.size(); ++k) {
    result.poses[k] = FromBlock(landmarks.blocks()[k]);
  }
  return result;
}

const Formulation& PlaneLandmarksFormulation() {
  static constexpr Formulation kFormulation = {
      "plane_landmarks",          "Plane landmarks", "Geneva et al. 2018",
      /*needs_points=*/false,
      /*takes_priors=*/false,
      /*converges_slowly=*/false, nullptr,           SolvePlaneLandmarks};
  return kFormulation;
}

}  // namespace lamina
