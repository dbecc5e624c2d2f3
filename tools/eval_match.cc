#include "tools/eval_match.h"

#include <fmt/format.h>

#include <optional>

#include "core/error.h"
#include "core/trajectory_metrics.h"
#include "io/scan_source.h"
#include "io/trajectory_io.h"

namespace lamina {
namespace {

// "Tr:" of KITTI odometry's calib.txt. Who names a calibration wants it applied: no Tr, no result.
SE3 ReadCameraFromLidar(const std::string& path) {
  const std::optional<SE3> T_camera_lidar = ReadKittiCalibration(path);
  if (T_camera_lidar) return *T_camera_lidar;
  throw InputError(path + ": has no line \"Tr:\", the pose of the LiDAR in the camera's frame");
}

}  // namespace

Trajectory ReadTruth(const std::string& path, const std::string& calib,
                     const std::vector<StampNs>& stamps) {
  const Trajectory truth = ReadTrajectory(path, stamps);
  return calib.empty() ? truth : CameraToLidar(truth, ReadCameraFromLidar(calib));
}

bool HasStamps(const Trajectory& trajectory) {
  for (size_t i = 0; i < trajectory.size(); ++i) {
    if (trajectory[i].stamp_ns != static_cast<StampNs>(i)) return true;
  }
  return false;
}

ComparedTrajectory MatchToTruth(const NamedTrajectory& estimate, const Trajectory& truth,
                                double tolerance_s) {
  const bool stamped = HasStamps(truth);
  if (HasStamps(estimate.poses) != stamped) {
    throw InputError(fmt::format(
        "{} has stamps and {} has none, so their poses cannot be matched; give --scans to take "
        "stamps from the recording",
        stamped ? "the truth" : estimate.name, stamped ? estimate.name : "the truth"));
  }
  ComparedTrajectory compared{estimate.name, estimate.poses, truth};
  MatchByStamp(stamped ? tolerance_s : 0.0, &compared.estimate, &compared.truth);
  if (compared.truth.size() < 2) {
    throw InputError(fmt::format(
        "{}: {} of its {} poses match one of the truth's {} within {} s, at least 2 are needed",
        estimate.name, compared.truth.size(), estimate.poses.size(), truth.size(), tolerance_s));
  }
  return compared;
}

}  // namespace lamina
