// Point clusters: all that the bundle adjustment ever needs to know of a set of points.
//
// The paper (Huang et al., RA-L 2021, III-B2) keeps for the points of one frame in one voxel their
// number, mean and covariance. We store
//
//     n = count,   mu = mean,   S = sum_i (p_i - mu)(p_i - mu)'  (scatter),   Sigma = S / n
//
// that is, the sums (n, sum p, sum p p') in centred form. Clusters add and subtract exactly,
//
//     mu = (n1 mu1 + n2 mu2) / n,   S = S1 + S2 + (n1 n2 / n) (mu1 - mu2)(mu1 - mu2)'
//
// and move under a pose without looking at a point: mu -> R mu + t, S -> R S R'. The centred form
// needs no origin near the points: a plane 100 km from the world's origin stays as flat as it is.
// `count` is real: a weighted cluster (Scaled) behaves as if each point had that weight.
//
// A TimedCluster also keeps the moments with the points' times, so that a scan taken while the
// sensor moved can be put right under ANY motion, again and again, without its points.
#pragma once

#include <Eigen/Core>

#include "core/geometry/se3.h"
#include "core/geometry/sweep_motion.h"
#include "core/geometry/symmetric3.h"

namespace lamina {

struct PointCluster {
  double count = 0.0;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  Symmetric3 scatter;

  bool Empty() const { return count <= 0.0; }
  Symmetric3 Covariance() const { return scatter * (1.0 / count); }
  Eigen3 EigenPairs() const { return EigenDecompose(Covariance()); }

  void AddPoint(const Eigen::Vector3d& p) {
    const double n = count + 1.0;
    const Eigen::Vector3d d = p - mean;
    scatter.AddOuter(count / n, d);
    mean += d / n;
    count = n;
  }

  PointCluster& operator+=(const PointCluster& o) {
    if (o.count == 0.0) return *this;
    const double n = count + o.count;
    const Eigen::Vector3d d = o.mean - mean;
    scatter += o.scatter;
    scatter.AddOuter(count * o.count / n, d);
    mean += (o.count / n) * d;
    count = n;
    return *this;
  }

  // Removes a cluster that was added before. Removing all leaves an exactly empty cluster.
  PointCluster& operator-=(const PointCluster& o);

  // Each point's weight times s (s >= 0).
  PointCluster Scaled(double s) const {
    PointCluster c = *this;
    c.count *= s;
    c.scatter = scatter * s;
    return c;
  }

  // Its weight at most `most`.
  PointCluster Capped(double most) const { return count > most ? Scaled(most / count) : *this; }

  // The cluster of the points R p + t. R must be a rotation.
  PointCluster Moved(const Eigen::Matrix3d& R, const Eigen::Vector3d& t) const {
    PointCluster c;
    c.count = count;
    c.mean = R * mean + t;
    c.scatter = scatter.Rotated(R);
    return c;
  }
  PointCluster Moved(const SE3& T) const { return Moved(T.R(), T.t); }
};

// Points p_i, each measured at time tau_i (seconds, relative to the scan's reference instant,
// sweep_motion.h) in the LiDAR frame of that very instant.
struct TimedCluster {
  PointCluster points;                                   // as measured, not deskewed
  double mean_time_s = 0.0;                              // mean of tau
  double time_scatter = 0.0;                             // sum (tau - mean)^2
  Eigen::Vector3d point_time = Eigen::Vector3d::Zero();  // sum (p - mu)(tau - mean)

  // Whether any of its points was measured at another instant than tau = 0.
  bool Timed() const { return time_scatter > 0.0 || mean_time_s != 0.0; }

  TimedCluster& operator+=(const TimedCluster& o) {
    if (o.points.count == 0.0) return *this;
    const double share = o.points.count / (points.count + o.points.count);
    const double dt = o.mean_time_s - mean_time_s;
    time_scatter += o.time_scatter + points.count * share * dt * dt;
    point_time += o.point_time + points.count * share * dt * (o.points.mean - points.mean);
    mean_time_s += share * dt;
    points += o.points;
    return *this;
  }
};

}  // namespace lamina
