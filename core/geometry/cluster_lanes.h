// Four point clusters at once, one in each lane of a vector register.
//
// For loops over many clusters in functions that are compiled for several kinds of processor
// (core/base/processor.h), into which all of this is inlined: the same operations in the same order
// on each of them. Lanes do not touch one another, so what comes out of a cluster does not depend
// on which others it is taken with.
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <cstring>

#include "core/base/processor.h"
#include "core/geometry/point_cluster.h"

namespace lamina {

// Rows become columns.
[[gnu::always_inline]] inline void Transpose(Four* row) {
  const FourIntegers even{0, 4, 2, 6}, odd{1, 5, 3, 7}, low{0, 1, 4, 5}, high{2, 3, 6, 7};
  const Four even01 = __builtin_shuffle(row[0], row[1], even);
  const Four even23 = __builtin_shuffle(row[2], row[3], even);
  const Four odd01 = __builtin_shuffle(row[0], row[1], odd);
  const Four odd23 = __builtin_shuffle(row[2], row[3], odd);
  row[0] = __builtin_shuffle(even01, even23, low);
  row[1] = __builtin_shuffle(odd01, odd23, low);
  row[2] = __builtin_shuffle(even01, even23, high);
  row[3] = __builtin_shuffle(odd01, odd23, high);
}

// Four consecutive numbers at each of four places: columns[i] has the i-th ones.
[[gnu::always_inline]] inline void LoadColumns(const double* const* places, Four* columns) {
#pragma GCC unroll 4
  for (int k = 0; k < 4; ++k) std::memcpy(&columns[k], places[k], sizeof(Four));
  Transpose(columns);
}
[[gnu::always_inline]] inline void StoreColumns(const Four* columns, double* const* places) {
  Four row[4] = {columns[0], columns[1], columns[2], columns[3]};
  Transpose(row);
#pragma GCC unroll 4
  for (int k = 0; k < 4; ++k) std::memcpy(places[k], &row[k], sizeof(Four));
}

// A motion in each lane.
struct alignas(32) MotionLanes {
  Four R[3][3] = {}, t[3] = {};

  // The same in all.
  [[gnu::always_inline]] inline void Set(const Eigen::Matrix3d& rotation,
                                         const Eigen::Vector3d& translation) {
#pragma GCC unroll 3
    for (int r = 0; r < 3; ++r) {
#pragma GCC unroll 3
      for (int c = 0; c < 3; ++c) R[r][c] = Four{} + rotation(r, c);
      t[r] = Four{} + translation(r);
    }
  }

  [[gnu::always_inline]] inline void Load(const Eigen::Matrix3d* const* rotations,
                                          const Eigen::Vector3d* const* translations) {
    const double* place[4];
    Four columns[4];
    // Matrices are stored by columns.
#pragma GCC unroll 4
    for (int k = 0; k < 4; ++k) place[k] = rotations[k]->data();
    LoadColumns(place, columns);
    R[0][0] = columns[0], R[1][0] = columns[1], R[2][0] = columns[2], R[0][1] = columns[3];
#pragma GCC unroll 4
    for (int k = 0; k < 4; ++k) place[k] += 4;
    LoadColumns(place, columns);
    R[1][1] = columns[0], R[2][1] = columns[1], R[0][2] = columns[2], R[1][2] = columns[3];
    const auto column = [](double a, double b, double c, double d, Four* to) {
      *to = Four{a, b, c, d};
    };
    column(place[0][4], place[1][4], place[2][4], place[3][4], &R[2][2]);
#pragma GCC unroll 3
    for (int i = 0; i < 3; ++i) {
      column((*translations[0])(i), (*translations[1])(i), (*translations[2])(i),
             (*translations[3])(i), &t[i]);
    }
  }
};

// Numbers of four PointClusters, in their order.
struct alignas(32) ClusterLanes {
  Four count, mean[3], scatter[6];  // xx xy xz yy yz zz

  // From four places in memory, each the first number of a cluster.
  [[gnu::always_inline]] inline void Load(const double* a, const double* b, const double* c,
                                          const double* d) {
    const double* const first[4] = {a, b, c, d};
    const double* const middle[4] = {a + 4, b + 4, c + 4, d + 4};
    const double* const last[4] = {a + 6, b + 6, c + 6, d + 6};
    Four columns[4];
    LoadColumns(first, columns);
    count = columns[0], mean[0] = columns[1], mean[1] = columns[2], mean[2] = columns[3];
    LoadColumns(middle, scatter);
    LoadColumns(last, columns);
    scatter[4] = columns[2], scatter[5] = columns[3];
  }

  [[gnu::always_inline]] inline void Store(double* a, double* b, double* c, double* d) const {
    double* const first[4] = {a, b, c, d};
    double* const middle[4] = {a + 4, b + 4, c + 4, d + 4};
    double* const last[4] = {a + 6, b + 6, c + 6, d + 6};
    const Four columns[4] = {count, mean[0], mean[1], mean[2]};
    StoreColumns(columns, first);
    StoreColumns(scatter, middle);
    StoreColumns(scatter + 2, last);
  }

  // PointCluster::Capped.
  [[gnu::always_inline]] inline void Cap(double most) {
    const Four share = count > most ? most / count : Four{} + 1.0;
    count *= share;
#pragma GCC unroll 6
    for (int s = 0; s < 6; ++s) scatter[s] *= share;
  }

  // PointCluster::Moved.
  [[gnu::always_inline]] inline void Move(const MotionLanes& by) {
    constexpr int kPlace[3][3] = {{0, 1, 2}, {1, 3, 4}, {2, 4, 5}};
    Four moved[3], half[3][3];
#pragma GCC unroll 3
    for (int r = 0; r < 3; ++r) {
      moved[r] = by.R[r][0] * mean[0] + by.R[r][1] * mean[1] + by.R[r][2] * mean[2] + by.t[r];
#pragma GCC unroll 3
      for (int c = 0; c < 3; ++c) {
        half[r][c] = by.R[r][0] * scatter[kPlace[0][c]] + by.R[r][1] * scatter[kPlace[1][c]] +
                     by.R[r][2] * scatter[kPlace[2][c]];
      }
    }
#pragma GCC unroll 3
    for (int r = 0; r < 3; ++r) {
      mean[r] = moved[r];
#pragma GCC unroll 3
      for (int c = r; c < 3; ++c) {
        scatter[kPlace[r][c]] =
            half[r][0] * by.R[c][0] + half[r][1] * by.R[c][1] + half[r][2] * by.R[c][2];
      }
    }
  }
};
// The numbers of a cluster, one after another.
inline const double* NumbersOf(const PointCluster& cluster) { return &cluster.count; }
inline double* NumbersOf(PointCluster& cluster) { return &cluster.count; }
static_assert(sizeof(PointCluster) == 10 * sizeof(double));

// to[i] = from[i].Capped(most).Moved(R, t).
void MoveClusters(const PointCluster* from, std::size_t count, double most,
                  const Eigen::Matrix3d& R, const Eigen::Vector3d& t, PointCluster* to);

}  // namespace lamina
