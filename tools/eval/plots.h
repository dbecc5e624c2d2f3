// The pictures of an evaluation: the paths from above, and the error along the way.
#pragma once

#include <vector>

#include "core/geometry/scan.h"
#include "tools/metrics/map_quality.h"
#include "tools/metrics/match.h"
#include "tools/metrics/trajectory_metrics.h"
#include "tools/plot/gnuplot.h"

namespace lamina {

// x and y of every position, equal axes.
Plot TopViewPlot(const std::vector<NamedTrajectory>& trajectories);

// |T estimate - truth| (metres) over the distance along the truth, T the alignment.
Plot ErrorPlot(const std::vector<ComparedTrajectory>& compared, Alignment alignment);

}  // namespace lamina
