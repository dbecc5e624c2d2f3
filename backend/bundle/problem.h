// What a bundle adjustment is given: poses, and planes with the clusters that see them.
//
// Plain data, filled once before a solve and read by every formulation of the cost.
#pragma once

#include <cstdint>
#include <vector>

#include "core/geometry/point_cluster.h"
#include "core/geometry/se3.h"
#include "core/geometry/state_archive.h"

namespace lamina {

// The points of one frame on one plane: LiDAR frame of that frame, weights (cap, robust kernel)
// already applied by PointCluster::Scaled, and held during the solve.
struct PlaneObservation {
  int frame = 0;  // index into BundleProblem::poses
  PointCluster cluster;
};

// A point of an observation, LiDAR frame; its weight is that of its cluster's points.
struct WeightedPoint {
  Eigen::Vector3d p = Eigen::Vector3d::Zero();
  double weight = 1.0;
};

struct Plane {
  std::int32_t first = 0, count = 0;  // its observations: [first, first + count), frames ascending
  PointCluster fixed;                 // world frame; of frames that left the window; may be empty
  double weight = 1.0;                // 1 / variance of the plane's points or less, 1/m^2
};

// Plane::weight where a plane's points have this variance along its normal, and a sensor's noise is
// at least so much.
inline double PlaneWeight(double variance, double noise_floor_m) {
  return 1.0 / (noise_floor_m * noise_floor_m + variance);
}

// A measured motion between two frames of the window: T_a_b, with the information (inverse
// covariance) of the error LocalDelta(T_a_b, T_world_a^-1 T_world_b). Keeps what no plane sees.
struct RelativePrior {
  int a = 0, b = 0;
  SE3 T_a_b;
  Matrix6d sqrt_information = Matrix6d::Identity();
};

// A direction in which a frame does not move: a unit tangent vector of core/geometry/se3.h.
struct HeldDirection {
  int frame = 0;
  Vector6d direction = Vector6d::Zero();
};

struct BundleProblem {
  std::vector<SE3> poses;  // T_world_lidar, start values
  std::vector<Plane> planes;
  std::vector<PlaneObservation> observations;
  // The points of each observation. Only the point-wise formulation (evm1) asks for them; left
  // empty otherwise.
  std::vector<std::vector<WeightedPoint>> points;
  std::vector<RelativePrior> priors;
  // Directions along which frames stay: in batches what observability.h found open, in the sliding
  // window the degenerate directions of matches (SlidingWindow::HoldFirst).
  std::vector<HeldDirection> holds;
  // The first pose is held where nothing else holds the whole (no fixed cluster).
  bool hold_first_pose = true;
};

inline void Archive(StateArchive& a, PlaneObservation* o) { a(&o->frame, &o->cluster); }
inline void Archive(StateArchive& a, WeightedPoint* p) { a(&p->p, &p->weight); }
inline void Archive(StateArchive& a, Plane* p) { a(&p->first, &p->count, &p->fixed, &p->weight); }
inline void Archive(StateArchive& a, RelativePrior* p) {
  a(&p->a, &p->b, &p->T_a_b, &p->sqrt_information);
}
inline void Archive(StateArchive& a, HeldDirection* h) { a(&h->frame, &h->direction); }
inline void Archive(StateArchive& a, BundleProblem* p) {
  a(&p->poses, &p->planes, &p->observations, &p->points, &p->priors, &p->holds,
    &p->hold_first_pose);
}

}  // namespace lamina
