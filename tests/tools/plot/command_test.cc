#include "tools/plot/command.h"

#include <gtest/gtest.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <string>

#include "core/base/error.h"
#include "io/map/map_io.h"
#include "io/map/trajectory_io.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

class PlotCommand : public testing::Test {
 protected:
  PlotCommand()
      : folder_(testing::TempDir() + "lamina_plot_" +
                testing::UnitTest::GetInstance()->current_test_info()->name()) {
    fs::remove_all(folder_);
    fs::create_directories(folder_);
  }

  void WriteRun(int surfels) const {
    SurfelMap map;
    for (int i = 0; i < surfels; ++i) {
      map.push_back({Eigen::Vector3d(i, i % 7, 0.1 * i), Eigen::Vector3f::UnitZ(),
                     Eigen::Vector3f(0.1F, 0.1F, 1e-4F), 20});
    }
    WriteSurfels(folder_ + "/map_surfels.ply", map);
    Trajectory trajectory(3);
    for (int i = 0; i < 3; ++i) {
      trajectory[static_cast<std::size_t>(i)].stamp_ns = i;
      trajectory[static_cast<std::size_t>(i)].T_world_lidar.t.x() = i;
    }
    WriteTumTrajectory(folder_ + "/trajectory_tum.txt", trajectory);
  }

  static int Run(const std::string& line) {
    CLI::App app;
    std::function<int()> run;
    AddPlotCommand(&app, &run);
    app.parse(line, false);
    return run();
  }

  std::string folder_;
};

TEST_F(PlotCommand, DrawsIntoTheRunsFolder) {
  WriteRun(50);
  EXPECT_EQ(Run("plot --run " + folder_), 0);
  EXPECT_GT(fs::file_size(folder_ + "/map.png"), 1000U);
}

TEST_F(PlotCommand, RefusesAnEmptyMapAndAMissingRun) {
  WriteRun(0);
  EXPECT_THROW(Run("plot --run " + folder_), InputError);
  EXPECT_THROW(Run("plot --run " + folder_ + "/none"), InputError);
}

}  // namespace
}  // namespace lamina
