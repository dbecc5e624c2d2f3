#include "frontend/start/beam_agreement.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>

#include "core/geometry/robust_kernel.h"

namespace lamina {
namespace {

constexpr double kCellRad = M_PI / 180.0;
// Beams that lie within this distance of one another at their ends are taken to meet one surface.
constexpr double kBesideM = 0.08;
// Least cosine of the elevation: nearer to the vertical, cells of azimuth are too narrow.
constexpr double kLeastCosine = 0.25;

struct Cell {
  int azimuth = 0, elevation = 0;
};

Cell CellOf(const Eigen::Vector3d& direction) {
  const double azimuth = std::atan2(direction.y(), direction.x()) + M_PI;
  const double elevation = std::asin(std::clamp(direction.z(), -1.0, 1.0)) + 0.5 * M_PI;
  return {static_cast<int>(azimuth / kCellRad), static_cast<int>(elevation / kCellRad)};
}

}  // namespace

BeamAgreement::BeamAgreement(const std::vector<PointCluster>& clusters, double range_sigma_m)
    : range_sigma_m_(range_sigma_m), cells_(kAzimuths * kElevations + 1, 0) {
  std::vector<std::int32_t> cell_of(clusters.size(), -1);
  for (std::size_t i = 0; i < clusters.size(); ++i) {
    const double range = clusters[i].mean.norm();
    if (range <= 0.0) continue;
    const Cell cell = CellOf(clusters[i].mean / range);
    cell_of[i] = std::min(cell.elevation, kElevations - 1) * kAzimuths + cell.azimuth % kAzimuths;
    ++cells_[static_cast<std::size_t>(cell_of[i]) + 1];
  }
  std::partial_sum(cells_.begin(), cells_.end(), cells_.begin());
  beams_.resize(static_cast<std::size_t>(cells_.back()));
  std::vector<std::int32_t> next(cells_.begin(), cells_.end() - 1);
  for (std::size_t i = 0; i < clusters.size(); ++i) {
    if (cell_of[i] < 0) continue;
    const double range = clusters[i].mean.norm();
    const auto place = static_cast<std::size_t>(next[static_cast<std::size_t>(cell_of[i])]++);
    beams_[place] = {(clusters[i].mean / range).cast<float>(), static_cast<float>(range)};
  }
}

double BeamAgreement::NearestRange(const Eigen::Vector3d& point, double range_m) const {
  const Eigen::Vector3d direction = point / range_m;
  const double cosine = std::hypot(direction.x(), direction.y());
  if (cosine < kLeastCosine) return 0.0;
  const Cell middle = CellOf(direction);
  const int aside = static_cast<int>(std::ceil(1.0 / cosine));
  const Eigen::Vector3f wanted = direction.cast<float>();
  float nearest2 = static_cast<float>(std::pow(std::min(kBesideM / range_m, kCellRad), 2));
  double range = 0.0;
  for (int e = std::max(0, middle.elevation - 1);
       e <= std::min(kElevations - 1, middle.elevation + 1); ++e) {
    for (int k = -aside; k <= aside; ++k) {
      const int a = (middle.azimuth + k + kAzimuths) % kAzimuths;
      const auto cell = static_cast<std::size_t>(e * kAzimuths + a);
      for (std::int32_t i = cells_[cell]; i < cells_[cell + 1]; ++i) {
        const Beam& beam = beams_[static_cast<std::size_t>(i)];
        const float apart2 = (beam.direction - wanted).squaredNorm();
        if (apart2 >= nearest2) continue;
        nearest2 = apart2;
        range = static_cast<double>(beam.range_m);
      }
    }
  }
  return range;
}

template <typename Visit>
void BeamAgreement::ForEachRange(const std::vector<PointCluster>& clusters,
                                 const SE3& T_first_other, std::size_t stride,
                                 const Visit& visit) const {
  for (std::size_t i = 0; i < clusters.size(); i += stride) {
    const Eigen::Vector3d p = T_first_other * clusters[i].mean;
    const double range = p.norm();
    if (range > 0.0) visit(range, NearestRange(p, range));
  }
}

BeamAgreement::Sums BeamAgreement::Ask(const std::vector<PointCluster>& clusters,
                                       const SE3& T_first_other) const {
  constexpr std::size_t kMostAsked = 3000;
  const std::size_t stride = 1 + clusters.size() / kMostAsked;
  Sums sums;
  ForEachRange(clusters, T_first_other, stride, [&](double range, double nearest) {
    sums.asked += 1.0;
    if (nearest == 0.0) return;
    const double off = (range - nearest) / range_sigma_m_;
    sums.beside += 1.0;
    sums.agree += GemanMcClureWeight(off * off);
  });
  return sums;
}

std::vector<double> BeamAgreement::RangesOff(const std::vector<PointCluster>& clusters,
                                             const SE3& T_first_other) const {
  std::vector<double> off;
  ForEachRange(clusters, T_first_other, 1, [&](double range, double nearest) {
    if (nearest > 0.0) off.push_back(range - nearest);
  });
  return off;
}

BeamAgreement::Shares BeamAgreement::At(const std::vector<PointCluster>& clusters,
                                        const SE3& T_first_other) const {
  constexpr double kFew = 20.0;  // n_0
  const Sums sums = Ask(clusters, T_first_other);
  return {sums.asked > 0.0 ? sums.beside / sums.asked : 0.0, sums.agree / (sums.beside + kFew)};
}

double BeamAgreement::Beside(const std::vector<PointCluster>& clusters,
                             const SE3& T_first_other) const {
  return At(clusters, T_first_other).beside;
}

double BeamAgreement::Of(const std::vector<PointCluster>& clusters,
                         const SE3& T_first_other) const {
  return At(clusters, T_first_other).agree;
}

SE3 BeamAgreement::Climb(const std::vector<PointCluster>& clusters,
                         const SE3& T_first_other) const {
  constexpr double kFirstM = 0.08, kFirstRad = 0.014, kLeastM = 0.005, kBetter = 1e-4;
  SE3 T = T_first_other;
  double best = Of(clusters, T);
  for (double share = 1.0; share * kFirstM > kLeastM;) {
    bool moved = false;
    for (int axis = 0; axis < 6; ++axis) {
      for (const double sign : {1.0, -1.0}) {
        Vector6d step = Vector6d::Zero();
        step(axis) = sign * share * (axis < 3 ? kFirstRad : kFirstM);
        const SE3 beside = Retract(T, step);
        const double agreement = Of(clusters, beside);
        if (!(agreement > best + kBetter)) continue;
        best = agreement;
        T = beside;
        moved = true;
        break;
      }
    }
    if (!moved) share *= 0.5;
  }
  return T;
}

}  // namespace lamina
