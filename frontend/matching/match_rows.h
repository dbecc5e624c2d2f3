// Rows of the matching problem: one residual each, made for four clusters at a time and summed into
// normal equations whose entries stay in registers meanwhile.
//
// A row's numbers do not depend on which others it is made with, and sums are taken in the order of
// the rows, entry by entry: results have the same bits on every processor.
//
// `Four` in memory is aligned to 32 bytes by these types themselves: of its own it is so only where
// a function is compiled for registers of that size, and such functions rely on it.
#pragma once

#include <cstddef>
#include <cstdint>

#include "core/base/processor.h"
#include "core/geometry/point_cluster.h"
#include "core/geometry/se3.h"
#include "core/map/surface.h"

namespace lamina {

struct DirectionEvidence;
struct ScanMatcherOptions;

// The distance of a cluster along a unit normal, how it changes with the pose, and its weight.
struct alignas(32) MatchRow {
  double j[6] = {};            // by the tangent of core/geometry/se3.h: [mu x R'nu; nu]
  double distance = 0.0;       // m
  double normal_error2 = 0.0;  // rad^2: NormalError2
  double w = 0.0;              // 1/m^2
  // For planes only: the kernel's weight in [0, 1], and that times distance^2.
  double robust = 0.0, residual2 = 0.0;
  bool matched = false;  // a plane within reach; where it is farther off, all weights are 0
  bool rough = false;    // one of the axes of a leaf without a plane
  bool on_ring = false;  // such a leaf whose points are on one ring (line_of_sight.h)
  bool young = false;    // few frames have seen it, and it holds the line of sight
};
static_assert(sizeof(MatchRow) == 96);

// Pose at which rows are made, and noise of the sensor (MapResiduals).
struct RowSettings {
  Eigen::Matrix3d R;
  Eigen::Vector3d t;
  double kernel_sigma = 0.0;
  double most_weight = 0.0;          // of a cluster, points
  double floor2 = 0.0, beam2 = 0.0;  // m^2
  bool use_flat = true;              // planes that are met flatly (kFlatSine) weigh something
};

// rows[i] of the distance of *clusters[i] from the plane *planes[i], by the cost of scan_matcher.h.
// `count` is at least 1.
void MakePlaneRows(const PointCluster* const* clusters, const Surface* const* planes,
                   std::size_t count, const RowSettings& settings,
                   const ScanMatcherOptions& options, MatchRow* rows);

// Sums over rows: H = sum w j'j, g = sum w distance j, and those of the weights.
struct alignas(32) RowSums {
  // Rows 0 to 3 of each column of H, rows 4 and 5 of two columns at a time; g in the same way.
  Four upper[6], lower[3], g_upper, g_lower;
  Four weights;  // w, robust, residual2
  // Rows that are matched, and those of them that weigh something and are not young.
  std::int64_t matched, matched_old;

  RowSums();
  void Add(const MatchRow* rows, std::size_t count);
  // Adds h times H and f times g of `o`.
  void AddShare(const RowSums& o, double h, double f);

  Matrix6d H() const;
  Vector6d g() const;
  double weight() const { return weights[0]; }
  double robust() const { return weights[1]; }
  double residual2() const { return weights[2]; }
};

// Sums of what rows say along directions (degeneracy.h).
struct alignas(32) EvidenceSums {
  // By direction: the first four, and the last two with padding.
  struct Sums {
    Four upper, lower, upper_squares, lower_squares;
  };
  // Rows 0 to 5 of four columns of the directions; even and odd rows of the last two columns; what
  // the rotation has of each direction.
  Four upper[6], lower[3], turned_upper, turned_lower;
  Sums all, old;  // of all rows, of those that are not young

  // Columns: the directions, orthonormal, scaled tangent.
  explicit EvidenceSums(const Matrix6d& directions);
  // Row i is of the cluster clusters[of[i]].
  void Add(const MatchRow* rows, const std::size_t* of, std::size_t count,
           const PointCluster* clusters);
  static void Store(const Sums& sums, DirectionEvidence* evidence);
};

// Factors by which a row's Jacobian enters the pose step and the second step.
struct StepShares {
  double pose = 1.0, other = 0.0;
};
// Sums over rows with the factors p of the pose step and q of the second step: `pose` weighs H by
// p^2 and g by p, `other` by q^2 and q, `across` H by p q.
struct TwoStepRows {
  RowSums pose, across, other;

  void Add(const MatchRow& row, const StepShares& shares);
  void Add(const RowSums& rows, const StepShares& shares);
  TwoStepRows& operator+=(const TwoStepRows& o);
};

}  // namespace lamina
