#include "backend/bundle/formulations/huang_cost.h"

#include <algorithm>
#include <cmath>

#include "backend/bundle/frame_pass.h"

namespace lamina {

HuangCost::HuangCost(const BundleProblem& problem)
    : problem_(problem), index_(problem), axes_(problem.observations.size()) {
  for (std::size_t i = 0; i < axes_.size(); ++i) {
    const PointCluster& c = problem.observations[i].cluster;
    const Eigen3 eigen = c.EigenPairs();
    for (int k = 0; k < 2; ++k) {
      axes_[i].col(k) = std::sqrt(c.count * std::max(0.0, eigen.l(k))) * eigen.u.col(k);
    }
  }
}

void HuangCost::Linearise(const std::vector<SE3>& poses, ReducedSystem* system) {
  const PoseMatrices matrices(poses);
  held_ = MakePlaneFrames(problem_, matrices);
  system->cost = PassOverFrames(
      problem_, index_, matrices, false,
      [&](const FramePassItem& item) {
        const PlaneFrame& f = held_[item.plane_index];
        const double n = item.cluster.count, w = item.plane.weight;
        const Eigen::Vector3d m = item.R.transpose() * f.normal;
        Vector6d j;
        j << item.cluster.mean.cross(m), f.normal;
        const double distance = f.normal.dot(item.R * item.cluster.mean + item.t - f.mean);
        double square = n * distance * distance;
        item.D->noalias() += (w * n) * j * j.transpose();
        *item.g += (w * n * distance) * j;
        for (int k = 0; k < 2; ++k) {
          const Eigen::Vector3d axis = axes_[item.observation].col(k);
          const Eigen::Vector3d turn = axis.cross(m);
          item.D->topLeftCorner<3, 3>().noalias() += w * turn * turn.transpose();
          const double along = axis.dot(m);
          item.g->head<3>() += (w * along) * turn;
          square += along * along;
        }
        *item.cost += 0.5 * w * square;
      },
      system);
}

double HuangCost::Value(const std::vector<SE3>& poses) const {
  return SumOfSquares(
      problem_, PoseMatrices(poses),
      [&](std::size_t p, std::size_t o, const Eigen::Matrix3d& R, const Eigen::Vector3d& t) {
        const PlaneFrame& f = held_[p];
        const PointCluster& cluster = problem_.observations[o].cluster;
        const Eigen::Vector3d m = R.transpose() * f.normal;
        const double distance = f.normal.dot(R * cluster.mean + t - f.mean);
        return (axes_[o].transpose() * m).squaredNorm() + cluster.count * distance * distance;
      });
}

const Formulation& HuangFormulation() {
  static constexpr Formulation kFormulation = {"huang",
                                               "Huang",
                                               "Huang et al. 2021",
                                               /*needs_points=*/false,
                                               /*takes_priors=*/false,
                                               /*converges_slowly=*/true,
                                               MakeCost<HuangCost>};
  return kFormulation;
}

}  // namespace lamina
