#include "tools/plot/command.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <memory>
#include <string>

#include "core/base/error.h"
#include "io/points/scan_file.h"
#include "tools/plot/gnuplot.h"
#include "tools/results/output_folder.h"
#include "tools/results/piece_poses.h"
#include "tools/results/run_summary.h"

namespace lamina {
namespace {

struct PlotArguments {
  std::string run, out;
};

// Heights below and above which a few outliers lie.
Eigen::Vector2d HeightRange(const std::vector<Eigen::Vector3d>& points) {
  constexpr double kOutliers = 0.02;
  std::vector<double> z;
  for (const Eigen::Vector3d& p : points) z.push_back(p.z());
  std::sort(z.begin(), z.end());
  const auto at = [&](double share) {
    return z[static_cast<std::size_t>(share * static_cast<double>(z.size() - 1))];
  };
  const double low = at(kOutliers);
  return {low, std::max(low + 0.1, at(1.0 - kOutliers))};
}

int DrawRun(const PlotArguments& arguments) {
  const std::filesystem::path run(arguments.run);
  const std::string out = arguments.out.empty() ? (run / "map.png").string() : arguments.out;
  CheckReplacesNoResult("--out", out);
  Plot plot;
  plot.title = "Map (planes by height) and trajectory, from above";
  plot.x_label = "x [m]";
  plot.y_label = "y [m]";
  plot.equal_axes = true;
  plot.cloud.colour_label = "height [m]";
  for (const ScanPoint& p : ReadScanFile((run / "map_surfels.ply").string(), {}).points) {
    plot.cloud.points.emplace_back(p.x, p.y, p.z);
  }
  if (plot.cloud.points.empty()) {
    throw InputError((run / "map_surfels.ply").string() + ": the map is empty");
  }
  plot.cloud.colour_range = HeightRange(plot.cloud.points);
  PlotSeries path{"trajectory", {}};
  for (const StampedPose& pose :
       MovedBy(-ReadMapOrigin(arguments.run), ReadPiece(arguments.run, 0))) {
    path.points.push_back(pose.T_world_lidar.t.head<2>());
  }
  plot.series.push_back(std::move(path));
  WritePlot(plot, out);
  fmt::print("picture {}\n", out);
  return 0;
}

}  // namespace

void AddPlotCommand(CLI::App* app, std::function<int()>* run) {
  auto arguments = std::make_shared<PlotArguments>();
  CLI::App* command =
      app->add_subcommand("plot", "Draw the map and the trajectory of a run, seen from above");
  command->add_option("--run", arguments->run, "Folder that `lamina run` wrote to")->required();
  command->add_option("--out", arguments->out,
                      "Picture, .png or .svg; map.png in the run's folder if left out");
  command->callback([arguments, run] { *run = [arguments] { return DrawRun(*arguments); }; });
}

}  // namespace lamina
