#include "backend/condensed_cost.h"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>

#include "core/parallel.h"

namespace lamina {
namespace {

constexpr std::size_t kChunk = 128;  // planes

using Matrix36d = Eigen::Matrix<double, 3, 6>;

// Partial sums of one chunk of planes.
struct Partial {
  double cost = 0.0;
  Eigen::VectorXd g;
  Eigen::MatrixXd H;  // lower block triangle

  Partial& operator+=(const Partial& o) {
    cost += o.cost;
    if (o.g.size() == 0) return *this;
    if (g.size() == 0) {
      g = o.g;
      H = o.H;
    } else {
      g += o.g;
      H += o.H;
    }
    return *this;
  }
};

// Rotations as matrices, made once an evaluation.
struct PoseCache {
  explicit PoseCache(const std::vector<SE3>& poses) {
    R.reserve(poses.size());
    t.reserve(poses.size());
    for (const SE3& T : poses) {
      R.push_back(T.R());
      t.push_back(T.t);
    }
  }
  std::vector<Eigen::Matrix3d> R;
  std::vector<Eigen::Vector3d> t;
};

PointCluster Aggregate(const BundleProblem& problem, const Plane& plane, const PoseCache& poses) {
  PointCluster sum = plane.fixed;
  for (int i = plane.first; i < plane.first + plane.count; ++i) {
    const PlaneObservation& o = problem.observations[static_cast<std::size_t>(i)];
    const auto k = static_cast<std::size_t>(o.frame);
    sum += o.cluster.Moved(poses.R[k], poses.t[k]);
  }
  return sum;
}

// The frame of a plane: normal, the two directions in it, and 1/sqrt of the diagonal of P'P.
struct PlaneFrame {
  Eigen::Vector3d normal, u1, u2, mean;
  double scale1, scale2, scale3;
};

PlaneFrame MakeFrame(const PointCluster& sum, const Eigen3& eigen) {
  // A plane with no extent along u_j cannot turn about the other axis: no such variable then.
  const auto inverse_root = [&](double l) {
    return l > 1e-12 ? 1.0 / std::sqrt(sum.count * l) : 0.0;
  };
  return {eigen.u.col(2),
          eigen.u.col(0),
          eigen.u.col(1),
          sum.mean,
          inverse_root(eigen.l(0)),
          inverse_root(eigen.l(1)),
          1.0 / std::sqrt(sum.count)};
}

// Adds J'J and J'r of one observation to its block, and returns (P'P)^-1/2 P'J (3x6).
Matrix36d AddObservation(const PointCluster& c, const Eigen::Matrix3d& R, const Eigen::Vector3d& t,
                         const PlaneFrame& f, double weight, Eigen::Ref<Matrix6d> H,
                         Eigen::Ref<Vector6d> g) {
  const Eigen::Vector3d m = R.transpose() * f.normal;
  const Eigen::Vector3d x = R * c.mean + t - f.mean;
  Vector6d j;
  j << c.mean.cross(m), f.normal;
  const Vector6d nj = c.count * j;

  const Eigen::Vector3d Sm = c.scatter * m;
  const double r = f.normal.dot(x);
  g += weight * r * nj;
  g.head<3>() -= weight * m.cross(Sm);

  H.noalias() += weight * nj * j.transpose();
  const Eigen::Matrix3d M = Hat(m);
  H.topLeftCorner<3, 3>().noalias() += weight * (M * c.scatter.Dense() * M.transpose());

  Matrix36d rows;
  rows.row(0) = f.u1.dot(x) * nj.transpose();
  rows.row(0).head<3>() -= m.cross(c.scatter * (R.transpose() * f.u1)).transpose();
  rows.row(1) = f.u2.dot(x) * nj.transpose();
  rows.row(1).head<3>() -= m.cross(c.scatter * (R.transpose() * f.u2)).transpose();
  rows.row(2) = -nj.transpose();
  const double root = std::sqrt(weight);
  rows.row(0) *= root * f.scale1;
  rows.row(1) *= root * f.scale2;
  rows.row(2) *= root * f.scale3;
  return rows;
}

void AddPlane(const BundleProblem& problem, const Plane& plane, const PoseCache& poses,
              std::vector<Matrix36d>* rows, Partial* sum) {
  const PointCluster aggregate = Aggregate(problem, plane, poses);
  if (aggregate.Empty()) return;
  const Eigen3 eigen = aggregate.Eigen();
  const PlaneFrame frame = MakeFrame(aggregate, eigen);
  sum->cost += 0.5 * plane.weight * aggregate.count * std::max(0.0, eigen.l(2));
  rows->resize(static_cast<std::size_t>(plane.count));
  const PlaneObservation* observations = problem.observations.data() + plane.first;
  for (int i = 0; i < plane.count; ++i) {
    const auto k = static_cast<std::size_t>(observations[i].frame);
    const int b = 6 * observations[i].frame;
    (*rows)[static_cast<std::size_t>(i)] =
        AddObservation(observations[i].cluster, poses.R[k], poses.t[k], frame, plane.weight,
                       sum->H.block<6, 6>(b, b), sum->g.segment<6>(b));
  }
  for (int i = 0; i < plane.count; ++i) {
    const Matrix36d& row_i = (*rows)[static_cast<std::size_t>(i)];
    for (int k = 0; k <= i; ++k) {
      sum->H.block<6, 6>(6 * observations[i].frame, 6 * observations[k].frame).noalias() -=
          row_i.transpose() * (*rows)[static_cast<std::size_t>(k)];
    }
  }
}

}  // namespace

CondensedCost::CondensedCost(const BundleProblem& problem) : problem_(problem) {
  for (const Plane& plane : problem.planes) {
    for (int i = plane.first; i < plane.first + plane.count; ++i) {
      const int frame = problem.observations.at(static_cast<std::size_t>(i)).frame;
      const bool sorted =
          i == plane.first || problem.observations[static_cast<std::size_t>(i - 1)].frame < frame;
      if (frame >= 0 && static_cast<std::size_t>(frame) < problem.poses.size() && sorted) continue;
      std::ostringstream message;
      message << "observation " << i << " names frame " << frame << " of " << problem.poses.size()
              << "; frames of a plane must exist and ascend";
      throw std::logic_error(message.str());
    }
  }
}

double CondensedCost::Value(const std::vector<SE3>& poses) const {
  const PoseCache cache(poses);
  return ParallelSum(problem_.planes.size(), kChunk, 0.0, [&](std::size_t begin, std::size_t end) {
    double cost = 0.0;
    for (std::size_t i = begin; i < end; ++i) {
      const Plane& plane = problem_.planes[i];
      const PointCluster sum = Aggregate(problem_, plane, cache);
      if (!sum.Empty()) cost += 0.5 * plane.weight * sum.count * std::max(0.0, sum.Eigen().l(2));
    }
    return cost;
  });
}

double CondensedCost::Linearise(const std::vector<SE3>& poses, Eigen::VectorXd* gradient,
                                Eigen::MatrixXd* hessian) const {
  const PoseCache cache(poses);
  const auto size = static_cast<Eigen::Index>(6 * poses.size());
  Partial total = ParallelSum(problem_.planes.size(), kChunk, Partial(),
                              [&](std::size_t begin, std::size_t end) {
                                Partial sum;
                                sum.g.setZero(size);
                                sum.H.setZero(size, size);
                                std::vector<Matrix36d> rows;
                                for (std::size_t i = begin; i < end; ++i) {
                                  AddPlane(problem_, problem_.planes[i], cache, &rows, &sum);
                                }
                                return sum;
                              });
  if (total.g.size() == 0) {
    total.g.setZero(size);
    total.H.setZero(size, size);
  }
  *gradient = std::move(total.g);
  *hessian = total.H.selfadjointView<Eigen::Lower>();
  return total.cost;
}

double CondensedCost::LowerBound() const {
  double bound = 0.0;
  for (const Plane& plane : problem_.planes) {
    for (int i = plane.first; i < plane.first + plane.count; ++i) {
      const PointCluster& c = problem_.observations[static_cast<std::size_t>(i)].cluster;
      bound += 0.5 * plane.weight * c.count * std::max(0.0, c.Eigen().l(2));
    }
  }
  return bound;
}

PointCluster AggregatePlane(const BundleProblem& problem, const Plane& plane,
                            const std::vector<SE3>& poses) {
  return Aggregate(problem, plane, PoseCache(poses));
}

}  // namespace lamina
