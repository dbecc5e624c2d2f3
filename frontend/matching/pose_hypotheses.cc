#include "frontend/matching/pose_hypotheses.h"

#include <algorithm>
#include <cmath>

#include "core/base/angle.h"

namespace lamina {
namespace {

// Steps of a grid to either side of its middle.
int StepsIn(double range, double step) { return static_cast<int>(std::floor(range / step + 1e-9)); }

// How far from the prediction coarse hypotheses lie, in standard deviations.
constexpr double kSigmas = 2.0;
// Distance of hypotheses: a coarse descent converges from half of it.
constexpr double kStepM = 1.0;

// Offsets to all sides, as far as the prediction is uncertain where that is beyond what
// OffsetsAbout covers. Coarse.
std::vector<SE3> OffsetsAround(const PoseSearchOptions& options, const PosePrediction& prediction) {
  // Farther apart, two scans of a street hardly have a plane in common.
  constexpr double kMostM = 8.0;
  const double sigma = SigmaM(prediction);
  const double reach = std::min(kSigmas * sigma, kMostM);
  std::vector<SE3> hypotheses;
  if (reach < options.range_m + kStepM) return hypotheses;
  const SE3& centre = prediction.T_world_lidar;
  const int steps = static_cast<int>(std::ceil(reach / kStepM));
  for (int x = -steps; x <= steps; ++x) {
    for (int y = -steps; y <= steps; ++y) {
      const Eigen::Vector3d offset(kStepM * x, kStepM * y, 0.0);
      if (offset.norm() <= reach) hypotheses.emplace_back(centre.q, centre * offset);
    }
  }
  return hypotheses;
}

// Offsets along the way (unit vector, world), to either side of it and turned about the sensor's
// z axis, as far as the prediction is uncertain; `way_m` is the way predicted since the last
// pose. Coarse; empty where matching reaches as far itself.
std::vector<SE3> AlongTheWay(const PoseSearchOptions& options, const PosePrediction& prediction,
                             const Eigen::Vector3d& way, double way_m) {
  constexpr double kTurn = Radians(6.0);
  // Deviation to the side of a steady turn, relative to the distance.
  constexpr double kSideways = 0.05;
  const double sigma = SigmaM(prediction);
  const double turn_sigma = SigmaRad(prediction);
  const double reach = std::min(kSigmas * sigma, options.max_way_m);
  std::vector<SE3> hypotheses;
  if (reach < kStepM) return hypotheses;
  const SE3& centre = prediction.T_world_lidar;
  const Eigen::Vector3d up = centre.q * Eigen::Vector3d::UnitZ();
  const Eigen::Vector3d side = up.cross(way).normalized();
  const int steps = static_cast<int>(std::ceil(reach / kStepM));
  const int sides = static_cast<int>(std::ceil(std::min(reach, kSideways * way_m) / kStepM));
  const int turns = StepsIn(std::min(kSigmas * turn_sigma, Radians(options.range_deg)), kTurn);
  for (int along = -steps; along <= steps; ++along) {
    for (int about = -turns; about <= turns; ++about) {
      const double on_m = kStepM * along, turn = kTurn * about;
      // A steady turn leads to the side by half of it.
      const double aside_m = 0.5 * turn * std::max(0.0, way_m + on_m);
      for (int across = -sides; across <= sides; ++across) {
        hypotheses.emplace_back(centre.q * ExpSO3(turn * Eigen::Vector3d::UnitZ()),
                                centre.t + on_m * way + (aside_m + kStepM * across) * side);
      }
    }
  }
  return hypotheses;
}

}  // namespace

std::vector<SE3> TurnsAbout(const PoseSearchOptions& options, const std::vector<SE3>& centres) {
  const int steps = StepsIn(options.range_deg, options.step_deg);
  std::vector<SE3> hypotheses;
  for (const SE3& centre : centres) {
    for (int x = -steps; x <= steps; ++x) {
      for (int y = -steps; y <= steps; ++y) {
        for (int z = -steps; z <= steps; ++z) {
          const Eigen::Vector3d w = Radians(options.step_deg) * Eigen::Vector3d(x, y, z);
          hypotheses.emplace_back(centre.q * ExpSO3(w), centre.t);
        }
      }
    }
  }
  return hypotheses;
}

std::vector<SE3> TurnsAboutAxes(const PoseSearchOptions& options, const SE3& centre) {
  const double step_deg = 0.5 * options.step_deg;
  const int steps = StepsIn(options.range_deg, step_deg);
  std::vector<SE3> hypotheses;
  for (int axis = 0; axis < 3; ++axis) {
    for (int k = -steps; k <= steps; ++k) {
      const Eigen::Vector3d w = Radians(step_deg) * k * Eigen::Vector3d::Unit(axis);
      if (k != 0) hypotheses.emplace_back(centre.q * ExpSO3(w), centre.t);
    }
  }
  return hypotheses;
}

std::vector<SE3> AllRound(const std::vector<SE3>& centres) {
  constexpr int kTurns = 12;
  constexpr double kBesideM = 2.0;
  const Eigen::Vector3d offsets[] = {
      {0, 0, 0}, {kBesideM, 0, 0}, {-kBesideM, 0, 0}, {0, kBesideM, 0}, {0, -kBesideM, 0}};
  std::vector<SE3> hypotheses;
  for (const SE3& centre : centres) {
    for (const Eigen::Vector3d& offset : offsets) {
      for (int k = 0; k < kTurns; ++k) {
        const Eigen::Vector3d turn = 2.0 * M_PI * k / kTurns * Eigen::Vector3d::UnitZ();
        hypotheses.emplace_back(centre.q * ExpSO3(turn), centre * offset);
      }
    }
  }
  return hypotheses;
}

std::vector<SE3> OffsetsAbout(const PoseSearchOptions& options, const SE3& centre) {
  const int steps = StepsIn(options.range_m, options.step_m);
  std::vector<SE3> hypotheses;
  for (int x = -steps; x <= steps; ++x) {
    for (int y = -steps; y <= steps; ++y) {
      const Eigen::Vector3d offset(options.step_m * x, options.step_m * y, 0.0);
      hypotheses.emplace_back(centre.q, centre * offset);
    }
  }
  return hypotheses;
}

PoseHypotheses PoseHypotheses::Starting(const PoseSearchOptions& options,
                                        const PosePrediction& prediction, const SE3& T_world_last) {
  PoseHypotheses hypotheses;
  hypotheses.dense = OffsetsAbout(options, prediction.T_world_lidar);
  hypotheses.coarse = OffsetsAround(options, prediction);
  const std::vector<SE3> turns = TurnsAbout(options, {prediction.T_world_lidar, T_world_last});
  hypotheses.dense.insert(hypotheses.dense.end(), turns.begin(), turns.end());
  return hypotheses;
}

PoseHypotheses PoseHypotheses::GoingOn(const PoseSearchOptions& options,
                                       const PosePrediction& prediction, const SE3& T_world_last) {
  constexpr double kLeastWayM = 0.1;
  PoseHypotheses hypotheses;
  hypotheses.dense = TurnsAbout(options, {prediction.T_world_lidar, T_world_last});
  const Eigen::Vector3d way = prediction.T_world_lidar.t - T_world_last.t;
  // Beyond what is searched there may be a better place.
  if (way.norm() > kLeastWayM && kSigmas * SigmaM(prediction) <= options.max_way_m) {
    hypotheses.way = way.normalized();
    hypotheses.coarse = AlongTheWay(options, prediction, hypotheses.way, way.norm());
  }
  return hypotheses;
}

}  // namespace lamina
