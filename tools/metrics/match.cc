#include "tools/metrics/match.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <optional>

#include "core/base/error.h"
#include "io/map/trajectory_io.h"
#include "io/recording/scan_source.h"
#include "tools/metrics/trajectory_metrics.h"
#include "tools/metrics/truth_axes.h"

namespace lamina {
namespace {

// "Tr:" of KITTI odometry's calib.txt. Who names a calibration wants it applied: no Tr, no result.
SE3 ReadCameraFromLidar(const std::string& path) {
  const std::optional<SE3> T_camera_lidar = ReadKittiCalibration(path);
  if (T_camera_lidar) return *T_camera_lidar;
  throw InputError(path + ": has no line \"Tr:\", the pose of the LiDAR in the camera's frame");
}

}  // namespace

Trajectory WithCalibration(const Trajectory& truth, const std::string& calib) {
  return calib.empty() ? truth : CameraToLidar(truth, ReadCameraFromLidar(calib));
}

bool HasStamps(const Trajectory& trajectory) {
  for (size_t i = 0; i < trajectory.size(); ++i) {
    if (trajectory[i].stamp_ns != static_cast<StampNs>(i)) return true;
  }
  return false;
}

void RequireMatchable(const NamedTrajectory& estimate, const Trajectory& truth) {
  const bool stamped = HasStamps(truth);
  if (HasStamps(estimate.poses) != stamped) {
    throw InputError(fmt::format(
        "{} has stamps and {} has none, so their poses cannot be matched; give --scans to take "
        "stamps from the recording",
        stamped ? "the truth" : estimate.name, stamped ? estimate.name : "the truth"));
  }
  if (!stamped && estimate.poses.size() != truth.size()) {
    throw InputError(fmt::format(
        "{} has {} poses and the truth {}, neither with stamps: there must be as many of both, one "
        "for each scan, so they do not belong together. If they are of a part of the recording, "
        "`lamina eval --frames A:B` says which",
        estimate.name, estimate.poses.size(), truth.size()));
  }
}

ComparedTrajectory MatchPart(const NamedTrajectory& part, const Trajectory& truth,
                             double tolerance_s) {
  ComparedTrajectory compared{part.name, part.poses, truth};
  MatchByStamp(HasStamps(truth) ? tolerance_s : 0.0, &compared.estimate, &compared.truth);
  if (compared.truth.size() < 2) {
    throw InputError(fmt::format(
        "{}: {} of its {} poses match one of the truth's {} within {} s, at least 2 are needed",
        part.name, compared.truth.size(), part.poses.size(), truth.size(), tolerance_s));
  }
  if (2 * compared.truth.size() < std::min(part.poses.size(), truth.size())) {
    spdlog::warn(
        "{}: {} of its {} poses match one of the truth's {}, most do not: errors are of few",
        part.name, compared.truth.size(), part.poses.size(), truth.size());
  }
  return compared;
}

ComparedTrajectory MatchToTruth(const NamedTrajectory& estimate, const Trajectory& truth,
                                double tolerance_s) {
  RequireMatchable(estimate, truth);
  return MatchPart(estimate, truth, tolerance_s);
}

TrajectoryErrors ErrorsOf(const ComparedTrajectory& compared, Alignment alignment) {
  const std::string axes = DescribeOtherAxes(compared);
  if (!axes.empty()) spdlog::warn("{}", axes);
  return CompareTrajectories(compared.estimate, compared.truth, alignment);
}

}  // namespace lamina
