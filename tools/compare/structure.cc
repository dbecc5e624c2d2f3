#include "tools/compare/structure.h"

#include <fmt/format.h>

#include <Eigen/SVD>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>
#include <string_view>

#include "core/base/parallel.h"
#include "frontend/pairwise/pairwise_registration.h"
#include "io/file/file_writer.h"
#include "io/points/scan_file.h"
#include "tools/plot/gnuplot.h"

namespace lamina {
namespace {

constexpr double kCellM = 0.1;
constexpr double kMapVoxelM = 0.1;

std::array<std::uint8_t, 3> ColourOf(double error_m) {
  // The palette of tools/plot/gnuplot.cc.
  constexpr std::array<double, 4> kPlaces = {0.0, 0.35, 0.7, 1.0};
  constexpr std::array<std::array<double, 3>, 4> kColours = {
      {{0x1f, 0x3b, 0x73}, {0x2a, 0x9d, 0x8f}, {0xe9, 0xc4, 0x6a}, {0xd6, 0x28, 0x28}}};
  const double s = std::clamp(error_m / kStructuralRangeM, 0.0, 1.0);
  std::size_t i = 1;
  while (i + 1 < kPlaces.size() && s > kPlaces[i]) ++i;
  const double u = (s - kPlaces[i - 1]) / (kPlaces[i] - kPlaces[i - 1]);
  std::array<std::uint8_t, 3> colour;
  for (std::size_t c = 0; c < 3; ++c) {
    colour[c] =
        static_cast<std::uint8_t>(std::lround((1 - u) * kColours[i - 1][c] + u * kColours[i][c]));
  }
  return colour;
}

}  // namespace

ReferenceCloud::ReferenceCloud(const std::string& path) {
  std::vector<Eigen::Vector3f> points;
  for (const ScanPoint& p : ReadScanFile(path, {}).points) points.emplace_back(p.x, p.y, p.z);
  Build(points);
}

ReferenceCloud::ReferenceCloud(const std::vector<Eigen::Vector3f>& points) { Build(points); }

// Points sorted by the cell that they lie in.
void ReferenceCloud::Build(const std::vector<Eigen::Vector3f>& points) {
  std::vector<std::int32_t> cell(points.size(), VoxelIndex::kNone);
  std::vector<std::uint32_t> counts;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector3d p = points[i].cast<double>();
    if (!IsVoxelKeyInRange(p, 1.0 / kCellM)) continue;
    cell[i] =
        cells_.FindOrInsert(VoxelKeyOf(p, 1.0 / kCellM), static_cast<std::int32_t>(counts.size()));
    if (static_cast<std::size_t>(cell[i]) == counts.size()) counts.push_back(0);
    ++counts[static_cast<std::size_t>(cell[i])];
  }
  starts_.assign(counts.size() + 1, 0);
  std::partial_sum(counts.begin(), counts.end(), starts_.begin() + 1);
  std::vector<std::uint32_t> next(starts_.begin(), starts_.end() - 1);
  points_.resize(starts_.back());
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (cell[i] != VoxelIndex::kNone)
      points_[next[static_cast<std::size_t>(cell[i])]++] = points[i];
  }
}

double ReferenceCloud::Distance(const Eigen::Vector3f& p) const {
  float best2 = static_cast<float>(kStructuralBoundM * kStructuralBoundM);
  // Shells of cells: after the shell r, all within r cells have been seen. And of a shell, only the
  // cells that are nearer than the best point so far.
  constexpr int kShells = static_cast<int>(kStructuralBoundM / kCellM + 0.999);
  const Eigen::Array3d here = p.cast<double>().array();
  const Eigen::Array3d first = (here / kCellM).floor();
  for (int r = 0; r <= kShells; ++r) {
    const double seen = std::max(0, r - 1) * kCellM;
    if (static_cast<double>(best2) <= seen * seen) break;
    for (int i = 0; i < (2 * r + 1) * (2 * r + 1) * (2 * r + 1); ++i) {
      const int w = 2 * r + 1;
      const Eigen::Vector3i at(i % w - r, i / w % w - r, i / (w * w) - r);
      if (at.cwiseAbs().maxCoeff() != r) continue;
      const Eigen::Array3d low = kCellM * (first + at.cast<double>().array());
      const Eigen::Array3d beside = (low - here).max(here - low - kCellM).max(0.0);
      if (beside.square().sum() > static_cast<double>(best2)) continue;
      const Eigen::Vector3d q = low + 0.5 * kCellM;
      if (!IsVoxelKeyInRange(q, 1.0 / kCellM)) continue;
      const std::int32_t cell = cells_.Find(VoxelKeyOf(q, 1.0 / kCellM));
      if (cell == VoxelIndex::kNone) continue;
      const auto c = static_cast<std::size_t>(cell);
      for (std::uint32_t k = starts_[c]; k < starts_[c + 1]; ++k) {
        best2 = std::min(best2, (points_[k] - p).squaredNorm());
      }
    }
  }
  return std::sqrt(static_cast<double>(best2));
}

SE3 AlignPoses(const std::vector<SE3>& poses, const std::vector<SE3>& truth) {
  Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
  for (std::size_t i = 0; i < poses.size(); ++i) sum += truth[i].R() * poses[i].R().transpose();
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(sum, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Vector3d sign = Eigen::Vector3d::Ones();
  sign.z() = (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0.0 ? -1.0 : 1.0;
  const Eigen::Matrix3d R = svd.matrixU() * sign.asDiagonal() * svd.matrixV().transpose();
  Eigen::Vector3d t = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < poses.size(); ++i) {
    t += (truth[i].t - R * poses[i].t) / static_cast<double>(poses.size());
  }
  return SE3(R, t);
}

std::vector<MapPoint> MeasureStructure(const std::vector<std::vector<Eigen::Vector3f>>& scans,
                                       const std::vector<SE3>& poses, const std::vector<SE3>& truth,
                                       const ReferenceCloud& reference) {
  const SE3 T_truth_world = AlignPoses(poses, truth);
  VoxelIndex taken;
  std::vector<MapPoint> map;
  for (std::size_t k = 0; k < scans.size(); ++k) {
    const SE3 T = T_truth_world * poses[k];
    const Eigen::Matrix3d R = T.R();
    for (const Eigen::Vector3f& point : scans[k]) {
      const Eigen::Vector3d p = R * point.cast<double>() + T.t;
      if (!IsVoxelKeyInRange(p, 1.0 / kMapVoxelM)) continue;
      if (taken.Insert(VoxelKeyOf(p, 1.0 / kMapVoxelM))) {
        map.push_back({p.cast<float>(), 0.0F});
      }
    }
  }
  ParallelChunks(map.size(), 1024, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      map[i].error_m = static_cast<float>(reference.Distance(map[i].position));
    }
  });
  return map;
}

StructuralError Summarise(const std::vector<MapPoint>& map) {
  StructuralError out;
  constexpr std::size_t kBins = 50;
  constexpr double kBinM = kStructuralRangeM / kBins;
  out.points = map.size();
  out.distribution.assign(kBins + 1, 0.0);
  if (map.empty()) return out;
  const double share = 1.0 / static_cast<double>(map.size());
  std::vector<double> errors;
  for (const MapPoint& p : map) {
    const auto e = static_cast<double>(p.error_m);
    errors.push_back(e);
    out.mean_m += share * e;
    out.within_5cm += e < kStructuralRangeM ? share : 0.0;
    out.distribution[std::min(kBins, static_cast<std::size_t>(e / kBinM))] += share;
  }
  std::sort(errors.begin(), errors.end());
  const auto at = [&](double s) {
    return errors[static_cast<std::size_t>(s * static_cast<double>(errors.size() - 1))];
  };
  out.median_m = at(0.5);
  out.percentile90_m = at(0.9);
  return out;
}

void WriteHeatMap(const std::string& path, const std::vector<MapPoint>& map) {
  FileWriter file(path);
  file.Write(
      fmt::format("ply\nformat binary_little_endian 1.0\nelement vertex {}\n"
                  "property float x\nproperty float y\nproperty float z\n"
                  "property float error\n"
                  "property uchar red\nproperty uchar green\nproperty uchar blue\n"
                  "end_header\n",
                  map.size()));
  for (const MapPoint& p : map) {
    std::array<char, 19> bytes;
    std::memcpy(bytes.data(), p.position.data(), 12);
    std::memcpy(bytes.data() + 12, &p.error_m, 4);
    const auto colour = ColourOf(static_cast<double>(p.error_m));
    std::memcpy(bytes.data() + 16, colour.data(), 3);
    file.Write(std::string_view(bytes.data(), bytes.size()));
  }
  file.Commit();
}

void DrawHeatMap(const std::string& path, const std::string& title, double top_m,
                 const std::vector<MapPoint>& map) {
  // From 35 degrees above the horizon; `across` to the right, `up` in the picture, `behind` away.
  constexpr float kElevation = 0.61F, kHeading = 0.6F;
  constexpr int kColumns = 500, kRows = 360;
  const Eigen::Vector3f across(std::cos(kHeading), std::sin(kHeading), 0.0F);
  const Eigen::Vector3f away(-std::sin(kHeading), std::cos(kHeading), 0.0F);
  const Eigen::Vector3f up =
      std::sin(kElevation) * away + std::cos(kElevation) * Eigen::Vector3f::UnitZ();
  const Eigen::Vector3f behind =
      std::cos(kElevation) * away - std::sin(kElevation) * Eigen::Vector3f::UnitZ();
  Eigen::Array2f low = Eigen::Array2f::Constant(std::numeric_limits<float>::max()), high = -low;
  for (const MapPoint& p : map) {
    const Eigen::Array2f at(across.dot(p.position), up.dot(p.position));
    low = low.min(at), high = high.max(at);
  }
  const float pixel =
      std::max({(high.x() - low.x()) / kColumns, (high.y() - low.y()) / kRows, 1e-3F});
  // The nearest point of each pixel.
  std::vector<const MapPoint*> shown(static_cast<std::size_t>(kColumns + 1) * (kRows + 1));
  std::vector<float> depth(shown.size(), std::numeric_limits<float>::max());
  for (const MapPoint& p : map) {
    if (p.position.z() > static_cast<float>(top_m)) continue;
    const auto column = static_cast<std::size_t>((across.dot(p.position) - low.x()) / pixel);
    const auto row = static_cast<std::size_t>((up.dot(p.position) - low.y()) / pixel);
    const std::size_t at = row * (kColumns + 1) + column;
    const float d = behind.dot(p.position);
    if (at >= shown.size() || d >= depth[at]) continue;
    depth[at] = d;
    shown[at] = &p;
  }
  Plot plot;
  plot.title = title;
  plot.x_label = "[m]";
  plot.y_label = "[m], seen from 35 degrees above";
  plot.equal_axes = true;
  plot.cloud.colour_label = "distance to the true surface [cm]";
  plot.cloud.colour_range = {0.0, 100.0 * kStructuralRangeM};
  for (const MapPoint* p : shown) {
    if (p == nullptr) continue;
    plot.cloud.points.emplace_back(across.dot(p->position), up.dot(p->position),
                                   100.0 * static_cast<double>(p->error_m));
  }
  if (plot.cloud.points.empty()) return;
  WritePlot(plot, path);
}

}  // namespace lamina
