#include "backend/registration/pose_graph.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <stdexcept>

#include "backend/bundle/relative_pose_residual.h"
#include "core/base/angle.h"

namespace lamina {
namespace {

double Distance(const PoseGraphEdge& edge, const std::vector<SE3>& poses, double rotation_weight,
                double translation_weight) {
  const SE3 d = RelativeError(edge.T_from_to, poses[edge.from], poses[edge.to]);
  return std::hypot(rotation_weight * LogSO3(d.q).norm(), translation_weight * d.t.norm());
}

}  // namespace

void PoseGraphOptions::Visit(OptionVisitor& v) {
  v.Integer("max_iterations", &max_iterations, 1, 100000);
  v.Number("rotation_sigma_deg", &rotation_sigma_deg, 1e-6, 180.0);
  v.Number("translation_sigma_m", &translation_sigma_m, 1e-9, 1000.0);
  v.Number("kernel_sigma", &kernel_sigma, 0.01, 1000.0);
}

PoseGraphResult SpanningTreePoses(std::size_t poses, const std::vector<PoseGraphEdge>& edges) {
  PoseGraphResult result;
  std::vector<std::optional<SE3>> placed(poses);
  if (poses > 0) placed[0] = SE3();
  std::vector<std::size_t> order(edges.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return edges[a].weight > edges[b].weight; });
  // Prim's tree: the heaviest edge from what is placed to what is not.
  for (bool grown = true; grown;) {
    grown = false;
    for (const std::size_t e : order) {
      auto& from = placed.at(edges[e].from);
      auto& to = placed.at(edges[e].to);
      if (from.has_value() == to.has_value()) continue;
      if (from) {
        to = *from * edges[e].T_from_to;
      } else {
        from = *to * edges[e].T_from_to.Inverse();
      }
      grown = true;
      break;
    }
  }
  for (std::size_t k = 0; k < poses; ++k) {
    if (!placed[k]) {
      result.reason =
          "no registration that can be believed joins scan " + std::to_string(k) + " to the first";
      return result;
    }
    result.poses.push_back(*placed[k]);
  }
  result.good = true;
  return result;
}

PoseGraphResult SolvePoseGraph(std::size_t poses, const std::vector<PoseGraphEdge>& edges,
                               const PoseGraphOptions& options) {
  CheckOptions(options, "synchronisation.graph");
  PoseGraphResult result = SpanningTreePoses(poses, edges);
  if (!result.good || edges.empty()) return result;
  double mean = 0.0;
  for (const PoseGraphEdge& e : edges) mean += e.weight / static_cast<double>(edges.size());
  const auto weight = [&](const PoseGraphEdge& e, double sigma) {
    return std::sqrt(e.weight / mean) / sigma;
  };
  const double rotation_sigma = Radians(options.rotation_sigma_deg);
  ceres::Problem problem;
  for (SE3& pose : result.poses) {
    problem.AddParameterBlock(pose.q.coeffs().data(), 4, new ceres::EigenQuaternionManifold);
    problem.AddParameterBlock(pose.t.data(), 3);
  }
  for (const PoseGraphEdge& e : edges) {
    Vector6d root;
    root << Eigen::Vector3d::Constant(weight(e, rotation_sigma)),
        Eigen::Vector3d::Constant(weight(e, options.translation_sigma_m));
    ceres::CostFunction* cost = RelativePoseResidual::Cost(e.T_from_to, root.asDiagonal());
    SE3 &from = result.poses[e.from], &to = result.poses[e.to];
    problem.AddResidualBlock(cost, new GemanMcClureLoss(options.kernel_sigma),
                             from.q.coeffs().data(), from.t.data(), to.q.coeffs().data(),
                             to.t.data());
  }
  problem.SetParameterBlockConstant(result.poses[0].q.coeffs().data());
  problem.SetParameterBlockConstant(result.poses[0].t.data());
  ceres::Solver::Options solver;
  solver.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
  solver.max_num_iterations = options.max_iterations;
  solver.logging_type = ceres::SILENT;
  solver.num_threads = 1;
  ceres::Solver::Summary summary;
  ceres::Solve(solver, &problem, &summary);
  result.good = summary.IsSolutionUsable();
  if (!result.good) {
    result.reason = "the pose graph was not solved: " + summary.message;
    return result;
  }
  for (SE3& pose : result.poses) pose.q.normalize();
  for (const PoseGraphEdge& e : edges) {
    const double distance = Distance(e, result.poses, weight(e, rotation_sigma),
                                     weight(e, options.translation_sigma_m));
    if (distance > options.kernel_sigma) ++result.rejected;
  }
  return result;
}

}  // namespace lamina
