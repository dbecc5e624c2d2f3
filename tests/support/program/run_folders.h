// Folders of runs, as `lamina run` leaves them, out of a table that a test makes up.
#pragma once

#include <functional>
#include <set>
#include <string>
#include <vector>

#include "core/geometry/scan.h"
#include "io/map/map_io.h"
#include "io/map/trajectory_io.h"
#include "tests/support/files/io_test_files.h"
#include "tools/results/verdict/process_report.h"

namespace lamina {

class RunFolderTest : public FilesTest {
 protected:
  static constexpr int kMaxIterations = 20;  // as in the default configuration

  // 200 scans at 10 m/s, 10 a second, all as they should be but for what `change` does to scan i.
  static std::vector<ScanRecord> Drive(
      const std::function<void(int i, ScanRecord* scan)>& change = {}, int count = 200) {
    std::vector<ScanRecord> scans;
    for (int i = 0; i < count; ++i) {
      ScanRecord scan;
      scan.scan = i;
      scan.stamp_ns = 1'000'000'000'000LL + 100'000'000LL * i;
      scan.recorded_stamp = true;
      scan.status = i == 0 ? "first" : "tracked";
      scan.T_world_lidar.t.x() = 1.0 * i;
      scan.points = 20000;
      scan.clusters = 1000;
      scan.matched = i == 0 ? 0 : 800;
      scan.inlier_share = i == 0 ? 0.0 : 0.75;
      scan.residual_m = 0.03;
      scan.worst_sigma_m = 0.002;
      scan.iterations = i == 0 ? 0 : 6;
      scan.odometry_ms = 10.0;
      if (change) change(i, &scan);
      scans.push_back(scan);
    }
    return scans;
  }

  // The folder `name` with frames.csv, trajectories, summary.json and config.yaml.
  void WriteRun(const std::vector<ScanRecord>& scans, const std::string& name = "run") const {
    std::filesystem::create_directories(Path(name));
    FrameTable table(Path(name + "/frames.csv"), kMaxIterations);
    Trajectory posed, all;
    for (const ScanRecord& scan : scans) {
      table.Append(scan);
      all.push_back({scan.stamp_ns, scan.T_world_lidar});
      if (!scan.skipped) posed.push_back(all.back());
    }
    table.Commit();
    WriteTumTrajectory(Path(name + "/trajectory_tum.txt"), posed);
    WriteKittiTrajectory(Path(name + "/trajectory_kitti.txt"), all);
    WriteSurfels(Path(name + "/map_surfels.ply"),
                 {Surfel{{50, 3, 0}, {0, 0, 1}, {0.1F, 0.1F, 1e-4F}, 9},
                  Surfel{{52, -3, 0}, {0, 0, 1}, {0.1F, 0.1F, 1e-4F}, 9}});
    Write(name + "/config.yaml", "map:\n  root_size_m: 1.6\n");
    const nlohmann::json summary = {{"pieces", ToJson(table.pieces())},
                                    {"map_over_budget", false},
                                    {"map_peak_bytes", 1000000},
                                    {"verdict", ToJson(table.Judge())}};
    Write(name + "/summary.json", SummaryText(summary));
  }
};

}  // namespace lamina
