#include "frontend/matching/match_rows.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>

#include "core/geometry/cluster_lanes.h"
#include "core/geometry/degeneracy.h"
#include "frontend/matching/line_of_sight.h"
#include "frontend/matching/scan_matcher.h"

namespace lamina {
namespace {

[[gnu::always_inline]] inline void Dot(const Four* a, const Four* b, Four* dot) {
  *dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

// The numbers of four surfaces.
struct alignas(32) SurfaceLanes {
  Four normal[3], mean[3], variance, flatness, breadth2, frames;

  [[gnu::always_inline]] inline void Load(const Surface* const* s) {
    const double* const means[4] = {s[0]->mean.data(), s[1]->mean.data(), s[2]->mean.data(),
                                    s[3]->mean.data()};
    Four columns[4];  // the last one has two floats in the place of a double
    LoadColumns(means, columns);
    mean[0] = columns[0], mean[1] = columns[1], mean[2] = columns[2];
#pragma GCC unroll 3
    for (int i = 0; i < 3; ++i) {
      Widen(s[0]->normal[i], s[1]->normal[i], s[2]->normal[i], s[3]->normal[i], &normal[i]);
    }
    Widen(s[0]->variance, s[1]->variance, s[2]->variance, s[3]->variance, &variance);
    Widen(s[0]->flatness, s[1]->flatness, s[2]->flatness, s[3]->flatness, &flatness);
    Widen<int>(s[0]->frames, s[1]->frames, s[2]->frames, s[3]->frames, &frames);
    // In single precision, as the surface has it.
    const FourFloats thick = {s[0]->variance, s[1]->variance, s[2]->variance, s[3]->variance};
    const FourFloats flat = {s[0]->flatness, s[1]->flatness, s[2]->flatness, s[3]->flatness};
    breadth2 = __builtin_convertvector(thick / flat, Four);
  }

  template <typename T>
  [[gnu::always_inline]] static inline void Widen(T a, T b, T c, T d, Four* to) {
    *to = Four{static_cast<double>(a), static_cast<double>(b), static_cast<double>(c),
               static_cast<double>(d)};
  }
};

// NormalError2.
[[gnu::always_inline]] inline void NormalErrors(const SurfaceLanes& plane, double beam2,
                                                Four* errors2) {
  const Four least = Four{} + kLeastBreadth2;
  const Four breadth2 = least < plane.breadth2 ? plane.breadth2 : least;
  const Four thick = plane.variance > 0.0 ? plane.variance : Four{};
  *errors2 = kLeastNormalError * kLeastNormalError + (thick + beam2) / breadth2;
}

// The rows of four clusters (MakePlaneRows).
struct alignas(32) RowLanes {
  Four j[6], distance, normal_error2, w, robust, residual2;
  FourIntegers matched, young;

  [[gnu::always_inline]] inline void Store(MatchRow* const* rows) const {
    double* place[4];
    const Four after[4] = {j[4], j[5], distance, normal_error2};
#pragma GCC unroll 4
    for (int k = 0; k < 4; ++k) place[k] = rows[k]->j;
    StoreColumns(j, place);
#pragma GCC unroll 4
    for (int k = 0; k < 4; ++k) place[k] += 4;
    StoreColumns(after, place);
#pragma GCC unroll 4
    for (int k = 0; k < 4; ++k) {
      rows[k]->w = w[k];
      rows[k]->robust = robust[k];
      rows[k]->residual2 = residual2[k];
      rows[k]->matched = matched[k] != 0;
      rows[k]->rough = rows[k]->on_ring = false;
      rows[k]->young = young[k] != 0;
    }
  }
};

// w j'j and w e j of one row, in the layout of RowSums.
struct alignas(32) RowProducts {
  Four upper[6], lower[3], g_upper, g_lower;

  [[gnu::always_inline]] inline void Set(const MatchRow& row) {
    const double* const j = row.j;
    const Four j_upper = {j[0], j[1], j[2], j[3]}, j_lower = {j[4], j[5], j[4], j[5]};
    const Four wj_upper = row.w * j_upper, wj_lower = row.w * j_lower;
#pragma GCC unroll 6
    for (int c = 0; c < 6; ++c) upper[c] = wj_upper * j[c];
#pragma GCC unroll 3
    for (int c = 0; c < 3; ++c) {
      lower[c] = wj_lower * Four{j[2 * c], j[2 * c], j[2 * c + 1], j[2 * c + 1]};
    }
    g_upper = row.distance * wj_upper;
    g_lower = row.distance * wj_lower;
  }
};

// Adds h times H and f times g.
template <typename Rows>
[[gnu::always_inline]] inline void AddShareTo(const Rows& rows, double h, double f, RowSums* sum) {
#pragma GCC unroll 6
  for (int c = 0; c < 6; ++c) sum->upper[c] += h * rows.upper[c];
#pragma GCC unroll 3
  for (int c = 0; c < 3; ++c) sum->lower[c] += h * rows.lower[c];
  sum->g_upper += f * rows.g_upper;
  sum->g_lower += f * rows.g_lower;
}

[[gnu::always_inline]] inline void AddInformation(const Four& upper, const Four& lower,
                                                  EvidenceSums::Sums* sums) {
  sums->upper += upper;
  sums->lower += lower;
  sums->upper_squares += upper * upper;
  sums->lower_squares += lower * lower;
}

template <typename Rows>
[[gnu::always_inline]] inline void AddTwoSteps(const Rows& rows, const StepShares& shares,
                                               TwoStepRows* sum) {
  const double p = shares.pose, q = shares.other;
  AddShareTo(rows, p * p, p, &sum->pose);
  AddShareTo(rows, p * q, 0.0, &sum->across);
  AddShareTo(rows, q * q, q, &sum->other);
}

}  // namespace

LAMINA_FOR_EACH_PROCESSOR
void MakePlaneRows(const PointCluster* const* clusters, const Surface* const* planes,
                   std::size_t count, const RowSettings& settings,
                   const ScanMatcherOptions& options, MatchRow* rows) {
  const double young2 = options.young_sigma_m * options.young_sigma_m;
  const double most_distance = options.max_distance_m, most_weight = settings.most_weight;
  const double kernel_sigma = settings.kernel_sigma;
  const double flat_sine2 = settings.use_flat ? 0.0 : kFlatSine * kFlatSine;
  const double young_frames = options.young_frames;
  MotionLanes at;
  at.Set(settings.R, settings.t);
  for (std::size_t i = 0; i < count; i += 4) {
    const std::size_t last = count - 1;
    const std::size_t of[4] = {i, std::min(i + 1, last), std::min(i + 2, last),
                               std::min(i + 3, last)};
    const Surface* const faced[4] = {planes[of[0]], planes[of[1]], planes[of[2]], planes[of[3]]};
    MatchRow* const to[4] = {rows + of[0], rows + of[1], rows + of[2], rows + of[3]};
    ClusterLanes cluster;
    cluster.Load(NumbersOf(*clusters[of[0]]), NumbersOf(*clusters[of[1]]),
                 NumbersOf(*clusters[of[2]]), NumbersOf(*clusters[of[3]]));
    SurfaceLanes plane;
    plane.Load(faced);
    const Four* const mu = cluster.mean;
    const Four* const s = cluster.scatter;
    RowLanes row;
    Four from_plane[3], normal[3];  // the plane's mean to the cluster's; the normal, LiDAR frame
#pragma GCC unroll 3
    for (int a = 0; a < 3; ++a) {
      from_plane[a] =
          at.R[a][0] * mu[0] + at.R[a][1] * mu[1] + at.R[a][2] * mu[2] + at.t[a] - plane.mean[a];
      normal[a] = at.R[0][a] * plane.normal[0] + at.R[1][a] * plane.normal[1] +
                  at.R[2][a] * plane.normal[2];
    }
    Dot(plane.normal, from_plane, &row.distance);
    const Four across[3] = {s[0] * normal[0] + s[1] * normal[1] + s[2] * normal[2],
                            s[1] * normal[0] + s[3] * normal[1] + s[4] * normal[2],
                            s[2] * normal[0] + s[4] * normal[1] + s[5] * normal[2]};
    Four spread, along, sight2;
    Dot(normal, across, &spread);
    Dot(normal, mu, &along);
    Dot(mu, mu, &sight2);
    // DistanceVariance.
    const Four variance = settings.floor2 + plane.variance + spread / cluster.count;
    const Four distance2 = row.distance * row.distance;
    // GemanMcClureWeight.
    const Four one_and_e2 = 1.0 + distance2 / (variance * kernel_sigma * kernel_sigma);
    const Four robust = 1.0 / (one_and_e2 * one_and_e2);
    // AlongSight and SightWeight.
    const Four along2 = along * along;
    row.young = (plane.frames < young_frames) & (along2 < kAlongSine * kAlongSine * sight2);
    const Four doubt = row.young ? Four{} + young2 : Four{};
    const Four sight = along2 / (along2 + plane.flatness * sight2 + kAtSensorM2);
    const Four points = cluster.count > most_weight ? Four{} + most_weight : cluster.count;
    const Four w = sight * robust * points / (variance + doubt);
    row.matched = ~((row.distance > most_distance) | (-row.distance > most_distance));
    row.w = row.matched & ~(along2 < flat_sine2 * sight2) ? w : Four{};
    row.robust = row.matched ? robust : Four{};
    row.residual2 = row.matched ? robust * distance2 : Four{};
    NormalErrors(plane, settings.beam2, &row.normal_error2);
#pragma GCC unroll 3
    for (int a = 0; a < 3; ++a) {
      const int b = (a + 1) % 3, c = (a + 2) % 3;
      row.j[a] = mu[b] * normal[c] - mu[c] * normal[b];
      row.j[3 + a] = plane.normal[a];
    }
    row.Store(to);
  }
}

RowSums::RowSums() { std::memset(static_cast<void*>(this), 0, sizeof(*this)); }

LAMINA_FOR_EACH_PROCESSOR
void RowSums::Add(const MatchRow* rows, std::size_t count) {
  RowSums sum = *this;
  for (std::size_t i = 0; i < count; ++i) {
    RowProducts products;
    products.Set(rows[i]);
#pragma GCC unroll 6
    for (int c = 0; c < 6; ++c) sum.upper[c] += products.upper[c];
#pragma GCC unroll 3
    for (int c = 0; c < 3; ++c) sum.lower[c] += products.lower[c];
    sum.g_upper += products.g_upper;
    sum.g_lower += products.g_lower;
    sum.weights += Four{rows[i].w, rows[i].robust, rows[i].residual2, 0.0};
    sum.matched += static_cast<std::int64_t>(rows[i].matched);
    sum.matched_old +=
        static_cast<std::int64_t>(rows[i].matched & (rows[i].w > 0.0) & !rows[i].young);
  }
  *this = sum;
}

LAMINA_FOR_EACH_PROCESSOR
void RowSums::AddShare(const RowSums& o, double h, double f) { AddShareTo(o, h, f, this); }

Matrix6d RowSums::H() const {
  Matrix6d H;
  for (int c = 0; c < 6; ++c) {
    for (int r = 0; r < 4; ++r) H(r, c) = upper[c][r];
    for (int r = 4; r < 6; ++r) H(r, c) = lower[c / 2][2 * (c % 2) + r - 4];
  }
  return H;
}

Vector6d RowSums::g() const {
  Vector6d g;
  g << g_upper[0], g_upper[1], g_upper[2], g_upper[3], g_lower[0], g_lower[1];
  return g;
}

EvidenceSums::EvidenceSums(const Matrix6d& directions) {
  std::memset(static_cast<void*>(&all), 0, sizeof(all));
  std::memset(static_cast<void*>(&old), 0, sizeof(old));
  const Matrix6d& d = directions;
  const Vector6d t = d.topRows<3>().colwise().squaredNorm().transpose();
  for (int k = 0; k < 6; ++k) upper[k] = Four{d(k, 0), d(k, 1), d(k, 2), d(k, 3)};
  for (int k = 0; k < 3; ++k)
    lower[k] = Four{d(2 * k, 4), d(2 * k, 5), d(2 * k + 1, 4), d(2 * k + 1, 5)};
  turned_upper = Four{t(0), t(1), t(2), t(3)};
  turned_lower = Four{t(4), t(5), t(4), t(5)};
}

// DirectionEvidence::Add, with the sums in the order in which Eigen takes them.
LAMINA_FOR_EACH_PROCESSOR
void EvidenceSums::Add(const MatchRow* rows, const std::size_t* of, std::size_t count,
                       const PointCluster* clusters) {
  Sums sum_all = all, sum_old = old;
  const Four scale{kRotationArmM, kRotationArmM, kRotationArmM, 1.0};
  for (std::size_t i = 0; i < count; ++i) {
    const MatchRow& row = rows[i];
    const Four j = Four{row.j[0], row.j[1], row.j[2], row.j[3]} / scale;
    const Four along_upper = ((upper[0] * j[0]) + (upper[2] * j[2] + upper[4] * row.j[4])) +
                             ((upper[1] * j[1]) + (upper[3] * j[3] + upper[5] * row.j[5]));
    const Four halves = lower[0] * Four{j[0], j[0], j[1], j[1]} +
                        (lower[1] * Four{j[2], j[2], j[3], j[3]} +
                         lower[2] * Four{row.j[4], row.j[4], row.j[5], row.j[5]});
    const Four along_lower = halves + __builtin_shuffle(halves, FourIntegers{2, 3, 0, 1});
    const Eigen::Vector3d& mu = clusters[of[i]].mean;
    const double arm = std::sqrt(mu[0] * mu[0] + mu[1] * mu[1] + mu[2] * mu[2]) / kRotationArmM;
    const double error2 = row.normal_error2, turning2 = error2 * arm * arm - error2;
    Four upper_says = along_upper * along_upper - (error2 + turning2 * turned_upper);
    Four lower_says = along_lower * along_lower - (error2 + turning2 * turned_lower);
    upper_says = row.w * (upper_says > 0.0 ? upper_says : Four{});
    lower_says = row.w * (lower_says > 0.0 ? lower_says : Four{});
    AddInformation(upper_says, lower_says, &sum_all);
    if (!row.young) AddInformation(upper_says, lower_says, &sum_old);
  }
  all = sum_all;
  old = sum_old;
}

void EvidenceSums::Store(const Sums& sums, DirectionEvidence* evidence) {
  for (int k = 0; k < 4; ++k) {
    evidence->information(k) = sums.upper[k];
    evidence->squares(k) = sums.upper_squares[k];
  }
  for (int k = 4; k < 6; ++k) {
    evidence->information(k) = sums.lower[k - 4];
    evidence->squares(k) = sums.lower_squares[k - 4];
  }
}

LAMINA_FOR_EACH_PROCESSOR
void TwoStepRows::Add(const MatchRow& row, const StepShares& shares) {
  RowProducts products;
  products.Set(row);
  AddTwoSteps(products, shares, this);
}

LAMINA_FOR_EACH_PROCESSOR
void TwoStepRows::Add(const RowSums& rows, const StepShares& shares) {
  AddTwoSteps(rows, shares, this);
}

TwoStepRows& TwoStepRows::operator+=(const TwoStepRows& o) {
  pose.AddShare(o.pose, 1.0, 1.0);
  across.AddShare(o.across, 1.0, 1.0);
  other.AddShare(o.other, 1.0, 1.0);
  return *this;
}

}  // namespace lamina
