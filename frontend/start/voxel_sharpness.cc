#include "frontend/start/voxel_sharpness.h"

#include <algorithm>
#include <cstring>

#include "core/base/lane_math.h"
#include "core/geometry/cluster_lanes.h"

namespace lamina {
namespace {

// The four numbers at `first` of each voxel: columns[i] has the i-th ones.
template <typename T>
[[gnu::always_inline]] inline void LoadColumns(const T* const* voxels, Four* columns) {
#pragma GCC unroll 4
  for (int k = 0; k < 4; ++k) {
    FourFloats row;
    std::memcpy(&row, voxels[k], sizeof(row));
    columns[k] = __builtin_convertvector(row, Four);
  }
  Transpose(columns);
}

// cos(2/3 acos t) of t in [0, 1], to 4e-9: a polynomial in 2 t - 1 through its Chebyshev nodes.
[[gnu::always_inline]] inline void CosineOfTwoThirds(Four* t) {
  constexpr double kCoefficients[] = {0.766044443119,     0.247409042336,     -0.0155091816144,
                                      0.0024666706654,    -0.000504215075717, 0.00011530020059,
                                      -2.86001110723e-05, 8.98389279808e-06,  -2.44548950374e-06};
  const Four z = 2.0 * *t - 1.0;
  *t = Four{} + kCoefficients[8];
#pragma GCC unroll 8
  for (int i = 7; i >= 0; --i) *t = *t * z + kCoefficients[i];
}

// Covariances of four voxels.
struct alignas(32) CovarianceLanes {
  Four x, y, per_point;  // means, in the plan
  Four xx, xy, yy;

  [[gnu::always_inline]] inline explicit CovarianceLanes(const VoxelPlan* const* v) {
    Four first[4];  // n x y xx
    LoadColumns(v, first);
    const Four xy_sums{v[0]->xy, v[1]->xy, v[2]->xy, v[3]->xy};
    const Four yy_sums{v[0]->yy, v[1]->yy, v[2]->yy, v[3]->yy};
    per_point = 1.0 / first[0];
    x = per_point * first[1];
    y = per_point * first[2];
    xx = per_point * first[3] - x * x;
    xy = per_point * xy_sums - x * y;
    yy = per_point * yy_sums - y * y;
  }

  [[gnu::always_inline]] inline void LeastInPlan(Four* least) const {
    const Four half = 0.5 * (xx - yy);
    Four root = half * half + xy * xy;
    SquareRoots(&root);
    *least = 0.5 * (xx + yy) - root;
  }

  // With q = tr C / 3, B = C - q I, p^2 = tr B^2 / 6 and r = det B / (2 p^3), the three eigenvalues
  // are q + 2 p cos((acos r + 2 pi k) / 3), and the smallest is
  //
  //     q - 2 p cos(2/3 acos t),    t = sqrt((1 - r) / 2).
  [[gnu::always_inline]] inline void LeastInSpace(const VoxelHeights* const* heights,
                                                  Four* least) const {
    // Keeps r finite where all three eigenvalues are the same.
    constexpr double kNone = 1e-30;
    Four sums[4];  // z xz yz zz
    LoadColumns(heights, sums);
    const Four z = per_point * sums[0];
    const Four xz = per_point * sums[1] - x * z, yz = per_point * sums[2] - y * z,
               zz = per_point * sums[3] - z * z;
    const Four q = (1.0 / 3) * (xx + yy + zz);
    const Four bx = xx - q, by = yy - q, bz = zz - q;
    const Four p2 = (1.0 / 6) * (bx * bx + by * by + bz * bz) +
                    (1.0 / 3) * (xy * xy + xz * xz + yz * yz) + kNone;
    Four p = p2;
    SquareRoots(&p);
    const Four determinant =
        bx * (by * bz - yz * yz) - xy * (xy * bz - yz * xz) + xz * (xy * yz - by * xz);
    Four t = 0.5 - 0.25 * determinant / (p * p2);
    t = t > 0.0 ? t : Four{};
    SquareRoots(&t);
    CosineOfTwoThirds(&t);
    *least = q - 2.0 * p * t;
  }
};

}  // namespace

LAMINA_FOR_EACH_PROCESSOR
void FindSharpness(const VoxelPlan* plans, const VoxelHeights* heights, const std::int32_t* places,
                   std::size_t count, double noise2, float* sharpness) {
  for (std::size_t i = 0; i < count; i += 4) {
    const VoxelPlan* v[4];
    const VoxelHeights* h[4];
    for (std::size_t k = 0; k < 4; ++k) {
      const std::int32_t place = places[std::min(i + k, count - 1)];
      v[k] = plans + place;
      h[k] = heights == nullptr ? nullptr : heights + place;
    }
    const CovarianceLanes covariance(v);
    Four value;
    if (heights == nullptr) covariance.LeastInPlan(&value);
    if (heights != nullptr) covariance.LeastInSpace(h, &value);
    value = (value > 0.0 ? value : Four{}) + noise2;
    Logarithms(&value);
    for (std::size_t k = 0; k < 4 && i + k < count; ++k)
      sharpness[places[i + k]] = static_cast<float>(-0.5 * value[k]);
  }
}

}  // namespace lamina
