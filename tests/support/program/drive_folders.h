// Folders as `lamina run --loops on` leaves them, of drives through a town.
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "config/config.h"
#include "io/map/trajectory_io.h"
#include "tests/support/files/io_test_files.h"
#include "tests/support/scenes/mapped_drives.h"
#include "tools/results/submap_file.h"

namespace lamina {

class DriveFoldersTest : public FilesTest {
 protected:
  // The output folder of a run over a drive that began `start_s` seconds after the first day. Its
  // world is the frame of its first pose, and drifts. `corrected`: by the loops that it has found;
  // otherwise as odometry has it, without any.
  std::string MapDrive(const std::string& name, const Town& town, const std::vector<SE3>& drive,
                       int start_s, double turn_rad = 0.0004, bool corrected = true) {
    const MappedDrive mapped = lamina::MapDrive(town, drive, static_cast<unsigned>(start_s + 1),
                                                turn_rad, 1000000000LL * start_s);
    const LoopClosure& closure = *mapped.loops;
    Trajectory odometry = mapped.odometry;
    LaminaConfig config;
    config.loops = DriveLoopOptions();
    SubmapFrameView view;
    view.graph = closure.graph();
    AnchorCorrection correction;
    if (corrected) {
      correction = AnchorCorrection(closure.submaps(), closure.anchors());
    } else {
      view.graph.loops.clear();
      view.graph.kept_before.clear();
      for (std::size_t i = 0; i < closure.submaps().size(); ++i)
        view.graph.poses[i] = closure.submaps()[i].T_world_submap;
    }
    for (const Submap& submap : closure.submaps()) {
      view.submaps.push_back(&submap);
      view.pieces.push_back(0);
    }
    std::filesystem::create_directories(Path(name));
    WriteSubmaps(Path(name + "/" + kSubmapFileName), {view});
    std::string table = "scan,stamp_s,status,piece\n";
    for (std::size_t i = 0; i < odometry.size(); ++i) {
      odometry[i].T_world_lidar =
          correction.Corrected(odometry[i].stamp_ns, odometry[i].T_world_lidar);
      table += std::to_string(i) + ",";
      AppendSeconds(odometry[i].stamp_ns, &table);
      table += ",tracked,0\n";
    }
    WriteTumTrajectory(Path(name + "/trajectory_tum.txt"), odometry);
    Write(name + "/frames.csv", table);
    Write(name + "/config.yaml", ToYaml(config));
    return Path(name);
  }
  nlohmann::json Summary(const std::string& out = "out") const {
    return nlohmann::json::parse(Bytes(Path(out + "/summary.json")));
  }
  // Root mean square of the errors of a drive in the frame whose origin is at this true pose.
  double ErrorM(const std::string& file, const SE3& T_true_frame,
                const std::vector<SE3>& truth) const {
    const Trajectory poses = ReadTrajectory(Path(file));
    EXPECT_EQ(poses.size(), truth.size());
    double square = 0.0;
    for (std::size_t i = 0; i < poses.size(); ++i)
      square += (T_true_frame * poses[i].T_world_lidar.t - truth[i].t).squaredNorm();
    return std::sqrt(square / static_cast<double>(poses.size()));
  }
};

}  // namespace lamina
