#include "backend/calibration/beam_calibration.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <unordered_map>
#include <utility>

#include "backend/calibration/beam_system.h"
#include "core/base/angle.h"
#include "core/base/parallel.h"
#include "core/geometry/robust_kernel.h"
#include "frontend/scan/scan_clusters.h"
#include "frontend/scan/sensor_intrinsics.h"

namespace lamina {
namespace {

constexpr int kMostRounds = 10, kJudgedRound = 2;
constexpr double kKernelSigma = 3.0;
// Points of one plane err together: of what they say by their number, so much is believed.
constexpr double kIndependent = 0.1;
// What sensors are off by: all beams alike, and each beam besides.
constexpr double kCommonDeg = 0.5, kCommonM = 0.05, kEachDeg = 0.2, kEachM = 0.03;
// Weight of a cluster in the map.
constexpr double kClusterWeight = 4.0;
// Nearer to the sensor's axis an elevation is none.
constexpr double kLeastRadiusM = 0.01;

using Offsets = Eigen::VectorXd;  // e_0 (rad), r_0 (m), e_1, ...

struct BeamSegmentRound {
  ReducedBeamSystem system;
  double residual2 = 0.0, weight = 0.0;  // weighted sums over points on planes
};

std::vector<BeamOffset> TableOf(const std::vector<double>& elevations_rad, const Offsets& offsets) {
  std::vector<BeamOffset> beams;
  for (std::size_t b = 0; b < elevations_rad.size(); ++b) {
    const auto at = static_cast<Eigen::Index>(2 * b);
    beams.push_back({Degrees(elevations_rad[b]), Degrees(offsets(at)), offsets(at + 1)});
  }
  return beams;
}

std::vector<TimedPoint> CorrectedPoints(const std::vector<TimedPoint>& points,
                                        const BeamTable& table) {
  std::vector<TimedPoint> corrected = points;
  for (TimedPoint& p : corrected) table.Correct(1, &p.x, &p.y, &p.z);
  return corrected;
}

// The points of a frame, corrected, and the map of its segment.
using SegmentPoints = std::vector<std::vector<TimedPoint>>;

void CastPoints(const BeamCalibrationSegment& segment, const SegmentPoints& points, VoxelMap* map) {
  for (std::size_t k = 0; k < segment.size(); ++k) {
    const std::vector<TimedCluster> timed = BuildScanClusters(points[k], map->options().LeafSize());
    std::vector<PointCluster> clusters = DeskewClusters(timed, segment[k].sweep);
    for (PointCluster& c : clusters) {
      c = c.Moved(segment[k].T_world_lidar).Capped(kClusterWeight);
    }
    map->AddFrame(clusters, static_cast<std::int64_t>(k));
  }
  map->Refresh();
}

// Where the ray to a point meets its plane, whose normal is n and which is `residual` nearer along
// it. Derivatives are taken there: at the point itself they would hold its noise, and the sum of
// their products with the residuals would not be zero where planes are as they are, but shrink the
// world (all its heights, say) as that makes noise smaller.
Eigen::Vector3d OnPlane(const Eigen::Vector3d& p, const Eigen::Vector3d& n, double residual) {
  constexpr double kMostShare = 0.05;  // of the range; rays that graze the plane meet it anywhere
  const double by_range = n.dot(p);    // the residual's change as all of the range is added to it
  if (std::abs(residual) >= kMostShare * std::abs(by_range)) return p - residual * n;
  return (1.0 - residual / by_range) * p;
}

// Axes in a plane.
std::pair<Eigen::Vector3d, Eigen::Vector3d> AxesOf(const Eigen::Vector3d& normal) {
  const Eigen::Vector3d u1 = normal.unitOrthogonal();
  return {u1, normal.cross(u1)};
}

class RowMaker {
 public:
  RowMaker(const VoxelMap& map, const BeamTable& table) : map_(map), table_(table) {}

  // Rows of the points of frame k, `measured` being the corrected ones; those on no plane are left
  // out.
  void Add(std::size_t k, const BeamCalibrationFrame& frame,
           const std::vector<TimedPoint>& measured) {
    const double noise_floor_m = map_.options().noise_floor_m;
    for (std::size_t i = 0; i < measured.size(); ++i) {
      const TimedPoint& reported = frame.points[i];
      const int beam = table_.BeamOf(reported.x, reported.y, reported.z);
      if (beam == BeamTable::kNoBeam) continue;
      const TimedPoint& m = measured[i];
      const Eigen::Vector3d p(m.x, m.y, m.z);
      const SE3 D = frame.sweep.PoseAt(m.time_s);
      const Eigen::Vector3d q = D * p;
      const Eigen::Vector3d x = frame.T_world_lidar * q;
      const VoxelMap::NodeId node = map_.FindSurface(x);
      if (node == VoxelMap::kNoNode || map_.kind(node) != Surface::Kind::kPlane) continue;
      const Surface& plane = map_.plane(node);
      if (plane.frames < 2) continue;
      const Eigen::Vector3d n = plane.normal.cast<double>();
      const Eigen::Vector3d in_frame = frame.T_world_lidar.q.conjugate() * n;
      const Eigen::Vector3d at_point = D.q.conjugate() * in_frame;
      BeamRow row;
      row.plane = NumberOf(node);
      row.frame = static_cast<std::int32_t>(k);
      row.beam = beam;
      row.residual = plane.Distance(x);
      row.weight = kIndependent * PlaneWeight(static_cast<double>(plane.variance), noise_floor_m) *
                   KernelWeight(plane, x, noise_floor_m, kKernelSigma);
      const Eigen::Vector3d on_plane = OnPlane(p, at_point, row.residual);
      if (on_plane.head<2>().norm() < kLeastRadiusM) continue;
      const Eigen::Vector3d from_mean = frame.T_world_lidar * (D * on_plane) - plane.mean;
      row.by_pose << (D * on_plane).cross(in_frame), n;
      row.by_beam = IntrinsicsFieldAt(on_plane).transpose() * at_point;
      const auto [u1, u2] = AxesOf(n);
      row.by_plane << 1.0, u1.dot(from_mean), u2.dot(from_mean);
      rows_.push_back(row);
    }
  }

  // In the order of the planes.
  std::vector<BeamRow> Take() {
    std::stable_sort(rows_.begin(), rows_.end(),
                     [](const BeamRow& a, const BeamRow& b) { return a.plane < b.plane; });
    return std::move(rows_);
  }

 private:
  std::int32_t NumberOf(VoxelMap::NodeId node) {
    return numbers_.emplace(node, static_cast<std::int32_t>(numbers_.size())).first->second;
  }

  const VoxelMap& map_;
  const BeamTable& table_;
  std::unordered_map<VoxelMap::NodeId, std::int32_t> numbers_;
  std::vector<BeamRow> rows_;
};

BeamSegmentRound LineariseBeams(const BeamCalibrationSegment& segment, const BeamTable& table,
                                const VoxelMapOptions& map_options) {
  constexpr std::ptrdiff_t kLeastPoints = 12;
  SegmentPoints points;
  for (const BeamCalibrationFrame& frame : segment) {
    points.push_back(CorrectedPoints(frame.points, table));
  }
  VoxelMap map(map_options);
  CastPoints(segment, points, &map);
  RowMaker maker(map, table);
  for (std::size_t k = 0; k < segment.size(); ++k) maker.Add(k, segment[k], points[k]);
  const std::vector<BeamRow> rows = maker.Take();
  BeamSystem system(segment.size(), table.size());
  BeamSegmentRound round;
  for (auto begin = rows.begin(); begin != rows.end();) {
    const auto end = std::find_if(begin, rows.end(),
                                  [&](const BeamRow& row) { return row.plane != begin->plane; });
    if (end - begin >= kLeastPoints) {
      system.AddPlane(&*begin, &*begin + (end - begin));
      for (auto row = begin; row != end; ++row) {
        round.residual2 += row->weight * row->residual * row->residual;
        round.weight += row->weight;
      }
    }
    begin = end;
  }
  round.system = system.Reduce();
  return round;
}

// The inverse of the covariance common^2 11' + each^2 I of all elevations, and of all ranges.
Eigen::MatrixXd PriorInformation(Eigen::Index beams) {
  Eigen::MatrixXd prior = Eigen::MatrixXd::Zero(2 * beams, 2 * beams);
  const double common[2] = {Radians(kCommonDeg), kCommonM}, each[2] = {Radians(kEachDeg), kEachM};
  for (int u = 0; u < 2; ++u) {
    const double information = 1.0 / (each[u] * each[u]);
    const double shared = common[u] * common[u] * information * information /
                          (1.0 + static_cast<double>(beams) * common[u] * common[u] * information);
    for (Eigen::Index a = 0; a < beams; ++a) {
      prior(2 * a + u, 2 * a + u) += information;
      for (Eigen::Index b = 0; b < beams; ++b) prior(2 * a + u, 2 * b + u) -= shared;
    }
  }
  return prior;
}

Offsets StepOf(const std::vector<BeamSegmentRound>& rounds, const Offsets& offsets) {
  const Eigen::Index size = offsets.size();
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(size, size);
  Eigen::VectorXd g = Eigen::VectorXd::Zero(size);
  for (const BeamSegmentRound& round : rounds) {
    H += round.system.H;
    g += round.system.g;
  }
  const Eigen::MatrixXd prior = PriorInformation(size / 2);
  H += prior;
  g += prior * offsets;
  return -Eigen::LLT<Eigen::MatrixXd>(H).solve(g);
}

double ThicknessOfPlanes(const std::vector<BeamSegmentRound>& rounds) {
  double residual2 = 0.0, weight = 0.0;
  for (const BeamSegmentRound& round : rounds) {
    residual2 += round.residual2;
    weight += round.weight;
  }
  return weight > 0.0 ? std::sqrt(residual2 / weight) : 0.0;
}

// In the root mean square over beams: one that hardly any plane judges may go on moving.
bool IsSmall(const Offsets& step) {
  constexpr double kSmallDeg = 0.01, kSmallM = 0.001;
  const double beams = 0.5 * static_cast<double>(step.size());
  double elevation2 = 0.0, range2 = 0.0;
  for (Eigen::Index i = 0; i < step.size(); i += 2) {
    elevation2 += step(i) * step(i);
    range2 += step(i + 1) * step(i + 1);
  }
  return std::sqrt(elevation2 / beams) < Radians(kSmallDeg) && std::sqrt(range2 / beams) < kSmallM;
}

}  // namespace

BeamCalibrationResult CalibrateBeams(const std::vector<double>& elevations_rad,
                                     const VoxelMapOptions& map,
                                     std::vector<BeamCalibrationSegment>* segments,
                                     const std::atomic<bool>* stop) {
  BeamCalibrationResult result;
  Offsets offsets = Offsets::Zero(static_cast<Eigen::Index>(2 * elevations_rad.size()));
  for (int r = 0; r < kMostRounds && !(stop != nullptr && stop->load()); ++r) {
    const BeamTable table(TableOf(elevations_rad, offsets));
    std::vector<BeamSegmentRound> rounds(segments->size());
    ParallelChunks(segments->size(), 1, [&](std::size_t begin, std::size_t end) {
      for (std::size_t s = begin; s < end; ++s) {
        rounds[s] = LineariseBeams((*segments)[s], table, map);
      }
    });
    result.thickness_m = ThicknessOfPlanes(rounds);
    if (r == 0) result.thickness_before_m = result.thickness_m;
    // What beams have wrong shows at once.
    if (r == kJudgedRound && !result.Thinner()) break;
    const Offsets step = StepOf(rounds, offsets);
    offsets += step;
    for (std::size_t s = 0; s < segments->size(); ++s) {
      const ReducedBeamSystem& system = rounds[s].system;
      MovePoses(system.pose_step + system.pose_slope * step, &(*segments)[s]);
    }
    if (IsSmall(step)) break;
  }
  result.beams = TableOf(elevations_rad, offsets);
  return result;
}

}  // namespace lamina
