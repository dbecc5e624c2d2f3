#include "tools/metrics/trajectory_metrics.h"

#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <limits>

#include "core/base/angle.h"
#include "core/base/error.h"

namespace lamina {
namespace {

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

// (truth_i^-1 truth_j)^-1 (estimate_i^-1 estimate_j): identity where both moved alike.
SE3 RelativeError(const Trajectory& estimate, const Trajectory& truth, size_t i, size_t j) {
  const SE3 moved = estimate[i].T_world_lidar.Inverse() * estimate[j].T_world_lidar;
  const SE3 truly = truth[i].T_world_lidar.Inverse() * truth[j].T_world_lidar;
  return truly.Inverse() * moved;
}

double AngleDeg(const SE3& T) { return Degrees(LogSO3(T.q).norm()); }

// Path length from the start to each pose.
std::vector<double> Distances(const Trajectory& trajectory) {
  std::vector<double> distance(trajectory.size(), 0.0);
  for (size_t i = 1; i < trajectory.size(); ++i) {
    distance[i] = distance[i - 1] +
                  (trajectory[i].T_world_lidar.t - trajectory[i - 1].T_world_lidar.t).norm();
  }
  return distance;
}

SegmentError ErrorOfSegments(const Trajectory& estimate, const Trajectory& truth,
                             const std::vector<double>& distance, double length_m, size_t step) {
  SegmentError error;
  error.length_m = length_m;
  double translation = 0.0;
  double rotation = 0.0;
  for (size_t i = 0; i < truth.size(); i += step) {
    const auto end = std::lower_bound(distance.begin(), distance.end(), distance[i] + length_m);
    if (end == distance.end()) break;
    const SE3 E = RelativeError(estimate, truth, i, static_cast<size_t>(end - distance.begin()));
    translation += E.t.norm() / length_m;
    rotation += AngleDeg(E) / length_m;
    ++error.segments;
  }
  error.translation_percent = error.segments > 0 ? 100.0 * translation / error.segments : kNan;
  error.rotation_deg_per_m = error.segments > 0 ? rotation / error.segments : kNan;
  return error;
}

void FillAbsoluteErrors(const Trajectory& estimate, const Trajectory& truth, Alignment alignment,
                        TrajectoryErrors* errors) {
  const SE3 T = AlignTrajectories(estimate, truth, alignment);
  double sum = 0.0;
  double squares = 0.0;
  for (size_t i = 0; i < truth.size(); ++i) {
    const double e = (T * estimate[i].T_world_lidar.t - truth[i].T_world_lidar.t).norm();
    sum += e;
    squares += e * e;
    errors->ape_max_m = std::max(errors->ape_max_m, e);
  }
  const auto n = static_cast<double>(truth.size());
  errors->ape_mean_m = sum / n;
  errors->ape_rmse_m = std::sqrt(squares / n);
}

void FillFrameErrors(const Trajectory& estimate, const Trajectory& truth,
                     TrajectoryErrors* errors) {
  double metres2 = 0.0;
  double degrees2 = 0.0;
  for (size_t i = 0; i + 1 < truth.size(); ++i) {
    const SE3 E = RelativeError(estimate, truth, i, i + 1);
    metres2 += E.t.squaredNorm();
    degrees2 += AngleDeg(E) * AngleDeg(E);
  }
  const auto n = static_cast<double>(truth.size() - 1);
  errors->rpe_rmse_m = std::sqrt(metres2 / n);
  errors->rpe_rmse_deg = std::sqrt(degrees2 / n);
}

void FillSegmentErrors(const Trajectory& estimate, const Trajectory& truth,
                       const std::vector<double>& distance, TrajectoryErrors* errors) {
  for (const double length : {5.0, 10.0, 20.0, 50.0}) {
    errors->short_segments.push_back(ErrorOfSegments(estimate, truth, distance, length, 1));
  }
  double translation = 0.0;
  double rotation = 0.0;
  int segments = 0;
  for (int hundreds = 1; hundreds <= 8; ++hundreds) {
    const SegmentError e = ErrorOfSegments(estimate, truth, distance, 100.0 * hundreds, 10);
    errors->kitti_segments.push_back(e);
    if (e.segments == 0) continue;
    // The benchmark averages over segments, not over lengths.
    translation += e.translation_percent * e.segments;
    rotation += e.rotation_deg_per_m * e.segments;
    segments += e.segments;
  }
  errors->kitti_trel_percent = segments > 0 ? translation / segments : kNan;
  errors->kitti_rrel_deg_per_m = segments > 0 ? rotation / segments : kNan;
}

void RequirePairs(const Trajectory& estimate, const Trajectory& truth) {
  if (estimate.size() == truth.size() && estimate.size() >= 2) return;
  throw InputError("comparing trajectories needs at least 2 poses and as many in both: " +
                   std::to_string(estimate.size()) + " poses in the estimate, " +
                   std::to_string(truth.size()) + " in the truth");
}

// Rotation and translation that bring the estimate's positions to the truth's with the least sum of
// squares. Positions on a line leave the turn about it open; any is as good.
SE3 LeastSquaresAlignment(const Trajectory& estimate, const Trajectory& truth) {
  const auto n = static_cast<double>(truth.size());
  Eigen::Vector3d mean_estimate = Eigen::Vector3d::Zero();
  Eigen::Vector3d mean_truth = Eigen::Vector3d::Zero();
  for (size_t i = 0; i < truth.size(); ++i) {
    mean_estimate += estimate[i].T_world_lidar.t / n;
    mean_truth += truth[i].T_world_lidar.t / n;
  }
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  for (size_t i = 0; i < truth.size(); ++i) {
    covariance += (truth[i].T_world_lidar.t - mean_truth) *
                  (estimate[i].T_world_lidar.t - mean_estimate).transpose() / n;
  }
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(covariance,
                                              Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Vector3d sign = Eigen::Vector3d::Ones();
  // Umeyama's S: a rotation, never a reflection.
  if ((svd.matrixU() * svd.matrixV().transpose()).determinant() < 0.0) sign.z() = -1.0;
  const SE3 rotation(Eigen::Matrix3d(svd.matrixU() * sign.asDiagonal() * svd.matrixV().transpose()),
                     Eigen::Vector3d::Zero());
  return SE3(rotation.q, mean_truth - rotation * mean_estimate);
}

std::vector<size_t> OrderByStamp(const Trajectory& trajectory) {
  std::vector<size_t> order(trajectory.size());
  for (size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::stable_sort(order.begin(), order.end(), [&](size_t a, size_t b) {
    return trajectory[a].stamp_ns < trajectory[b].stamp_ns;
  });
  return order;
}

// Position in `trajectory` (ascending stamps, not empty) of the stamp nearest to `stamp`.
size_t NearestByStamp(const Trajectory& trajectory, StampNs stamp) {
  const auto after =
      std::lower_bound(trajectory.begin(), trajectory.end(), stamp,
                       [](const StampedPose& pose, StampNs s) { return pose.stamp_ns < s; });
  if (after == trajectory.begin()) return 0;
  const auto before = after - 1;
  const bool take_before =
      after == trajectory.end() || stamp - before->stamp_ns <= after->stamp_ns - stamp;
  return static_cast<size_t>((take_before ? before : after) - trajectory.begin());
}

Trajectory Picked(const Trajectory& trajectory, const std::vector<size_t>& indices) {
  Trajectory picked;
  picked.reserve(indices.size());
  for (const size_t i : indices) picked.push_back(trajectory[i]);
  return picked;
}

}  // namespace

SE3 AlignTrajectories(const Trajectory& estimate, const Trajectory& truth, Alignment alignment) {
  RequirePairs(estimate, truth);
  switch (alignment) {
    case Alignment::kSe3:
      return LeastSquaresAlignment(estimate, truth);
    case Alignment::kFirst:
      return truth.front().T_world_lidar * estimate.front().T_world_lidar.Inverse();
    case Alignment::kNone:
      break;
  }
  return SE3();
}

TrajectoryErrors CompareTrajectories(const Trajectory& estimate, const Trajectory& truth,
                                     Alignment alignment) {
  RequirePairs(estimate, truth);
  const std::vector<double> distance = Distances(truth);
  TrajectoryErrors errors;
  errors.poses = static_cast<int>(truth.size());
  errors.length_m = distance.back();
  errors.first_to_last_m =
      (estimate.back().T_world_lidar.t - estimate.front().T_world_lidar.t).norm();
  FillAbsoluteErrors(estimate, truth, alignment, &errors);
  FillFrameErrors(estimate, truth, &errors);
  FillSegmentErrors(estimate, truth, distance, &errors);
  return errors;
}

void MatchByStamp(double tolerance_s, Trajectory* estimate, Trajectory* truth) {
  const Trajectory a = Picked(*estimate, OrderByStamp(*estimate));
  const Trajectory b = Picked(*truth, OrderByStamp(*truth));
  const StampNs tolerance_ns = std::llround(tolerance_s * 1e9);
  std::vector<size_t> from_a;
  std::vector<size_t> from_b;
  const auto gap = [&](size_t i, size_t j) { return std::abs(a[i].stamp_ns - b[j].stamp_ns); };
  for (size_t i = 0; i < a.size() && !b.empty(); ++i) {
    const size_t j = NearestByStamp(b, a[i].stamp_ns);
    if (gap(i, j) > tolerance_ns) continue;
    // A true pose serves once, for the estimate nearest to it.
    if (!from_b.empty() && from_b.back() == j) {
      if (gap(i, j) < gap(from_a.back(), j)) from_a.back() = i;
      continue;
    }
    from_a.push_back(i);
    from_b.push_back(j);
  }
  *estimate = Picked(a, from_a);
  *truth = Picked(b, from_b);
}

}  // namespace lamina
