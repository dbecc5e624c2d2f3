#include "io/map/trajectory_io.h"

#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <iterator>

#include "core/base/error.h"
#include "io/file/file_writer.h"
#include "io/file/text_input.h"
#include "io/points/ethz_csv.h"

namespace lamina {
namespace {

StampedPose ReadTumLine(const LineReader& lines, const std::vector<double>& numbers) {
  if (numbers.size() != 8) {
    lines.Fail(fmt::format("a TUM pose has 8 numbers (stamp tx ty tz qx qy qz qw), found {}",
                           numbers.size()));
  }
  for (const double value : numbers) {
    if (!std::isfinite(value)) lines.Fail("the numbers of a pose must be finite");
  }
  StampedPose pose;
  if (!ParseSecondsNs(lines.Words()[0], &pose.stamp_ns)) {
    lines.Fail(fmt::format("'{}' is not a stamp in decimal seconds that fits 64 bits of ns",
                           lines.Words()[0]));
  }
  const Eigen::Quaterniond q(numbers[7], numbers[4], numbers[5], numbers[6]);
  if (!(std::abs(q.norm() - 1.0) <= 1e-3)) {
    lines.Fail(fmt::format("the quaternion has norm {}, must be 1 within 1e-3", q.norm()));
  }
  pose.T_world_lidar = SE3(q, Eigen::Vector3d(numbers[1], numbers[2], numbers[3]));
  return pose;
}

StampedPose ReadKittiLine(const LineReader& lines, const std::vector<double>& numbers,
                          std::size_t index, const std::vector<StampNs>& stamps_ns) {
  StampedPose pose;
  pose.T_world_lidar = PoseFromRowMajor(numbers, lines);
  if (stamps_ns.empty()) {
    pose.stamp_ns = static_cast<StampNs>(index);
  } else if (index < stamps_ns.size()) {
    pose.stamp_ns = stamps_ns[index];
  } else {
    lines.Fail(fmt::format("there are more poses than the {} stamps known", stamps_ns.size()));
  }
  return pose;
}

Trajectory ReadEthz(const std::string& path, const std::vector<StampNs>& stamps_ns) {
  bool has_stamps = false;
  Trajectory trajectory = ReadLeicaPoses(path, &has_stamps);
  if (stamps_ns.empty()) return trajectory;
  if (stamps_ns.size() < trajectory.size()) {
    throw InputError(fmt::format("{}: holds {} poses, more than the {} stamps known", path,
                                 trajectory.size(), stamps_ns.size()));
  }
  for (std::size_t i = 0; i < trajectory.size(); ++i) trajectory[i].stamp_ns = stamps_ns[i];
  return trajectory;
}

}  // namespace

Trajectory ReadTrajectory(const std::string& path, const std::vector<StampNs>& stamps_ns) {
  if (std::filesystem::path(path).extension() == ".csv") return ReadEthz(path, stamps_ns);
  const std::string text = ReadFile(path);
  LineReader lines(path, text);
  Trajectory trajectory;
  std::vector<double> numbers;
  bool tum = false;
  while (lines.Next()) {
    lines.Numbers(&numbers);
    if (trajectory.empty()) {
      tum = numbers.size() == 8;
      if (!tum && numbers.size() != 12) {
        lines.Fail(
            fmt::format("a pose has 12 numbers (KITTI) or 8 (TUM), found {}", numbers.size()));
      }
    }
    trajectory.push_back(tum ? ReadTumLine(lines, numbers)
                             : ReadKittiLine(lines, numbers, trajectory.size(), stamps_ns));
  }
  if (trajectory.empty()) throw InputError(fmt::format("{}: holds no pose", path));
  return trajectory;
}

Trajectory CameraToLidar(const Trajectory& cameras, const SE3& T_camera_lidar) {
  const SE3 T_lidar_camera = T_camera_lidar.Inverse();
  Trajectory lidars = cameras;
  for (StampedPose& pose : lidars) {
    pose.T_world_lidar = T_lidar_camera * pose.T_world_lidar * T_camera_lidar;
  }
  return lidars;
}

void AppendSeconds(StampNs stamp_ns, std::string* text) {
  // The magnitude as unsigned: the smallest StampNs has no positive counterpart.
  const bool negative = stamp_ns < 0;
  const auto bits = static_cast<std::uint64_t>(stamp_ns);
  const std::uint64_t ns = negative ? 0 - bits : bits;
  fmt::format_to(std::back_inserter(*text), "{}{}.{:09d}", negative ? "-" : "", ns / 1000000000,
                 ns % 1000000000);
}

void AppendPoseLine(const StampedPose& pose, TrajectoryForm form, std::string* text) {
  if (form == TrajectoryForm::kKitti) {
    Eigen::Matrix<double, 3, 4, Eigen::RowMajor> T;
    T << pose.T_world_lidar.R(), pose.T_world_lidar.t;
    fmt::format_to(std::back_inserter(*text), "{}\n",
                   fmt::join(T.data(), T.data() + T.size(), " "));
    return;
  }
  AppendSeconds(pose.stamp_ns, text);
  const Eigen::Vector3d& t = pose.T_world_lidar.t;
  const Eigen::Quaterniond& q = pose.T_world_lidar.q;
  fmt::format_to(std::back_inserter(*text), " {} {} {} {} {} {} {}\n", t.x(), t.y(), t.z(), q.x(),
                 q.y(), q.z(), q.w());
}

namespace {

void WriteTrajectory(const std::string& path, const Trajectory& trajectory, TrajectoryForm form) {
  FileWriter writer(path);
  std::string line;
  for (const StampedPose& pose : trajectory) {
    line.clear();
    AppendPoseLine(pose, form, &line);
    writer.Write(line);
  }
  writer.Commit();
}

}  // namespace

void WriteKittiTrajectory(const std::string& path, const Trajectory& trajectory) {
  WriteTrajectory(path, trajectory, TrajectoryForm::kKitti);
}

void WriteTumTrajectory(const std::string& path, const Trajectory& trajectory) {
  WriteTrajectory(path, trajectory, TrajectoryForm::kTum);
}

}  // namespace lamina
