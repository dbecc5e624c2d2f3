#include "backend/anchors/anchor_graph.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <optional>

#include "backend/anchors/loop_innovation.h"
#include "backend/bundle/relative_pose_residual.h"
#include "core/base/disjoint_sets.h"

namespace lamina {
namespace {

Vector6d Difference(const AnchorEdge& edge, const std::vector<SE3>& poses) {
  const SE3 d = RelativeError(edge.T_from_to, poses.at(edge.from), poses.at(edge.to));
  Vector6d difference;
  difference << 2.0 * (d.q.w() < 0.0 ? -1.0 : 1.0) * d.q.vec(), d.t;
  return difference;
}

// A loss under which an edge says nothing.
class NoSay final : public ceres::LossFunction {
 public:
  void Evaluate(double, double out[3]) const override { out[0] = out[1] = out[2] = 0.0; }
};

// The graph as Ceres has it.
class CeresGraph {
 public:
  CeresGraph(const AnchorGraph& graph, const AnchorGraphOptions& options, std::vector<SE3>* poses)
      : graph_(graph), poses_(*poses) {
    for (SE3& pose : poses_) {
      problem_.AddParameterBlock(pose.q.coeffs().data(), 4, new ceres::EigenQuaternionManifold);
      problem_.AddParameterBlock(pose.t.data(), 3);
    }
    for (const AnchorEdge& edge : graph.odometry) Add(edge, nullptr);
    for (const AnchorEdge& edge : graph.loops) {
      losses_.push_back(new ceres::LossFunctionWrapper(nullptr, ceres::TAKE_OWNERSHIP));
      Add(edge, losses_.back());
    }
    Hold();
    solver_.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
    solver_.max_num_iterations = options.max_iterations;
    solver_.logging_type = ceres::SILENT;
    solver_.num_threads = 1;
    solver_.function_tolerance = 1e-9;
  }

  // By least squares of odometry and the loops kept.
  bool Solve(AnchorGraphResult* result) {
    for (std::size_t i = 0; i < losses_.size(); ++i)
      losses_[i]->Reset(result->kept[i] ? nullptr : new NoSay, ceres::TAKE_OWNERSHIP);
    ceres::Solver::Summary summary;
    ceres::Solve(solver_, &problem_, &summary);
    for (SE3& pose : poses_) pose.q.normalize();
    result->iterations += static_cast<int>(summary.iterations.size());
    if (!summary.IsSolutionUsable()) result->reason = summary.message;
    return summary.IsSolutionUsable();
  }

  // Of all loops at the present poses, those in result->kept counting; nothing if edges have no
  // finite value.
  std::optional<std::vector<Innovation>> Innovations(AnchorGraphResult* result) {
    const std::optional<std::vector<LinearEdge>> edges = Linearise();
    if (edges) return LoopInnovations(*edges, graph_.odometry.size(), result->kept);
    result->reason = "its edges could not be evaluated";
    return std::nullopt;
  }

 private:
  void Add(const AnchorEdge& edge, ceres::LossFunction* loss) {
    SE3 &from = poses_.at(edge.from), &to = poses_.at(edge.to);
    edges_.push_back(problem_.AddResidualBlock(
        RelativePoseResidual::Cost(edge.T_from_to, edge.SquareRootTimes(Matrix6d::Identity())),
        loss, from.q.coeffs().data(), from.t.data(), to.q.coeffs().data(), to.t.data()));
  }

  // All edges, odometry first, whatever their losses.
  std::optional<std::vector<LinearEdge>> Linearise() {
    ceres::Problem::EvaluateOptions options;
    options.apply_loss_function = false;
    options.residual_blocks = edges_;
    for (SE3& pose : poses_) {
      if (problem_.IsParameterBlockConstant(pose.t.data())) continue;
      options.parameter_blocks.push_back(pose.q.coeffs().data());
      options.parameter_blocks.push_back(pose.t.data());
    }
    std::vector<double> residuals;
    ceres::CRSMatrix J;
    if (!problem_.Evaluate(options, nullptr, &residuals, nullptr, &J)) return std::nullopt;
    std::vector<LinearEdge> edges(edges_.size());
    for (std::size_t row = 0; row < residuals.size(); ++row) {
      LinearEdge& edge = edges[row / 6];
      const auto k = static_cast<Eigen::Index>(row % 6);
      edge.residual(k) = residuals[row];
      for (int i = J.rows[row]; i < J.rows[row + 1]; ++i) {
        const auto at = static_cast<std::size_t>(i);
        const int pose = J.cols[at] / 6, column = J.cols[at] % 6;
        LinearEdge::End& end =
            edge.ends[edge.ends[0].pose < 0 || edge.ends[0].pose == pose ? 0 : 1];
        end.pose = pose;
        end.J(k, column) = J.values[at];
      }
    }
    return edges;
  }

  // The fixed poses, and the first pose of each part that edges join where there is none of them.
  void Hold() {
    DisjointSets parts(poses_.size());
    for (const auto* edges : {&graph_.odometry, &graph_.loops}) {
      for (const AnchorEdge& edge : *edges) parts.Join(edge.from, edge.to);
    }
    std::vector<bool> held(poses_.size(), false);  // the part of which this is the first pose
    for (const std::size_t i : graph_.fixed) {
      held.at(parts.Find(i)) = true;
      Hold(&poses_[i]);
    }
    for (std::size_t i = 0; i < poses_.size(); ++i) {
      if (parts.Find(i) == i && !held[i]) Hold(&poses_[i]);
    }
  }
  void Hold(SE3* pose) {
    problem_.SetParameterBlockConstant(pose->q.coeffs().data());
    problem_.SetParameterBlockConstant(pose->t.data());
  }

  const AnchorGraph& graph_;
  std::vector<SE3>& poses_;
  std::vector<ceres::LossFunctionWrapper*> losses_;  // owned by the problem
  ceres::Problem problem_;
  std::vector<ceres::ResidualBlockId> edges_;  // odometry, then loops
  ceres::Solver::Options solver_;
};

// One round: the worst contradicted loop goes, or the surest of those that fit come. False when
// nothing changes.
bool ChangeKept(const std::vector<Innovation>& innovations, const std::vector<bool>& excluded,
                double gate2, std::vector<bool>* kept) {
  std::size_t worst = innovations.size();
  std::vector<std::size_t> fitting;
  for (std::size_t i = 0; i < innovations.size(); ++i) {
    const double square = innovations[i].square;
    if (!(*kept)[i]) {
      if (square <= gate2 && !excluded[i]) fitting.push_back(i);
    } else if (square > gate2 &&
               (worst == innovations.size() || square > innovations[worst].square)) {
      worst = i;
    }
  }
  if (worst < innovations.size()) {
    (*kept)[worst] = false;
    return true;
  }
  std::stable_sort(fitting.begin(), fitting.end(), [&](std::size_t a, std::size_t b) {
    return innovations[a].uncertainty < innovations[b].uncertainty;
  });
  constexpr std::size_t kShare = 4;
  if (!fitting.empty()) fitting.resize((fitting.size() + kShare - 1) / kShare);
  for (const std::size_t i : fitting) (*kept)[i] = true;
  return !fitting.empty();
}

// Rounds until nothing changes, from the loops that are kept.
bool SolveRounds(const std::vector<bool>& excluded, double gate2, CeresGraph* ceres_graph,
                 AnchorGraphResult* result) {
  bool good = ceres_graph->Solve(result);
  // A loop that has come and gone may come again once: no rounds without end.
  const std::size_t most = 2 * excluded.size() + 2;
  for (std::size_t round = 0; round < most && good && !excluded.empty(); ++round) {
    const std::optional<std::vector<Innovation>> innovations = ceres_graph->Innovations(result);
    if (!innovations) return false;
    if (!ChangeKept(*innovations, excluded, gate2, &result->kept)) break;
    good = ceres_graph->Solve(result);
  }
  return good;
}

// Over odometry and the loops kept.
double Cost(const AnchorGraph& graph, const AnchorGraphResult& result) {
  double cost = 0.0;
  for (const AnchorEdge& edge : graph.odometry) cost += SquaredResidual(edge, result.poses);
  for (std::size_t i = 0; i < graph.loops.size(); ++i) {
    if (result.kept[i]) cost += SquaredResidual(graph.loops[i], result.poses);
  }
  return cost;
}

// Wrong loops that agree may have come first and kept the right ones out. What was kept out tries
// without them; what has the lower cost, each loop left out counting as the gate, stays.
bool TryWithout(const AnchorGraph& graph, double gate2, CeresGraph* ceres_graph,
                AnchorGraphResult* result) {
  const auto score = [&] {
    const auto out = std::count(result->kept.begin(), result->kept.end(), false);
    return Cost(graph, *result) + gate2 * static_cast<double>(out);
  };
  const std::vector<SE3> poses = result->poses;
  const std::vector<bool> kept = result->kept;
  const double first = score();
  std::copy(graph.poses.begin(), graph.poses.end(), result->poses.begin());
  result->kept.assign(kept.size(), false);
  const std::vector<bool> none(kept.size(), false);
  if (!SolveRounds(kept, gate2, ceres_graph, result) ||
      !SolveRounds(none, gate2, ceres_graph, result))
    return false;
  if (score() < first) return true;
  std::copy(poses.begin(), poses.end(), result->poses.begin());
  result->kept = kept;
  return true;
}

}  // namespace

void AnchorGraphOptions::Visit(OptionVisitor& v) {
  v.Integer("max_iterations", &max_iterations, 1, 100000);
  v.Number("gate_sigmas", &gate_sigmas, 0.1, 1000.0);
}

Matrix6d AnchorEdge::SquareRootTimes(const Matrix6d& J) const {
  const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(information);
  return eigen.eigenvalues().cwiseMax(0.0).cwiseSqrt().asDiagonal() *
         eigen.eigenvectors().transpose() * J;
}

double SquaredResidual(const AnchorEdge& edge, const std::vector<SE3>& poses) {
  const Vector6d d = Difference(edge, poses);
  return d.dot(edge.information * d);
}

std::string WhyLeftOut(const AnchorGraphResult& result) {
  return result.good ? "contradicts the other loops" : "could not be solved with: " + result.reason;
}

AnchorGraphResult SolveAnchorGraph(const AnchorGraph& graph, const AnchorGraphOptions& options) {
  CheckOptions(options, "loops.graph");
  AnchorGraphResult result;
  result.poses = graph.poses;
  std::vector<bool> kept_before = graph.kept_before;
  kept_before.resize(graph.loops.size(), false);
  result.kept = kept_before;
  for (const auto* edges : {&graph.odometry, &graph.loops}) {
    for (const AnchorEdge& edge : *edges) result.cost_before += SquaredResidual(edge, result.poses);
  }
  result.good = true;
  if (graph.odometry.empty() && graph.loops.empty()) return result;
  CeresGraph ceres_graph(graph, options, &result.poses);
  const double gate2 = options.gate_sigmas * options.gate_sigmas;
  const std::vector<bool> none(graph.loops.size(), false);
  result.good = SolveRounds(none, gate2, &ceres_graph, &result);
  const auto out = std::count(result.kept.begin(), result.kept.end(), false);
  constexpr std::ptrdiff_t kFew = 3, kShare = 5;
  if (result.good && out > kFew && kShare * out > static_cast<std::ptrdiff_t>(result.kept.size()))
    result.good = TryWithout(graph, gate2, &ceres_graph, &result);
  if (!result.good) {
    result.poses = graph.poses;
    result.kept = kept_before;
  }
  result.cost = Cost(graph, result);
  return result;
}

}  // namespace lamina
