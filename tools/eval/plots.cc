#include "tools/eval/plots.h"

namespace lamina {

Plot TopViewPlot(const std::vector<NamedTrajectory>& trajectories) {
  Plot plot{"Trajectory from above", "x (m)", "y (m)", true, {}};
  for (const NamedTrajectory& trajectory : trajectories) {
    PlotSeries series{trajectory.name, {}};
    for (const StampedPose& pose : trajectory.poses) {
      series.points.push_back(pose.T_world_lidar.t.head<2>());
    }
    plot.series.push_back(std::move(series));
  }
  return plot;
}

Plot ErrorPlot(const std::vector<ComparedTrajectory>& compared, Alignment alignment) {
  Plot plot{"Absolute position error", "distance along the truth (m)", "error (m)", false, {}};
  for (const ComparedTrajectory& c : compared) {
    const SE3 T = AlignTrajectories(c.estimate, c.truth, alignment);
    PlotSeries series{c.name, {}};
    double distance = 0.0;
    for (size_t i = 0; i < c.truth.size(); ++i) {
      const Eigen::Vector3d& truth = c.truth[i].T_world_lidar.t;
      if (i > 0) distance += (truth - c.truth[i - 1].T_world_lidar.t).norm();
      series.points.emplace_back(distance, (T * c.estimate[i].T_world_lidar.t - truth).norm());
    }
    plot.series.push_back(std::move(series));
  }
  return plot;
}

}  // namespace lamina
