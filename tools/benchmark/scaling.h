// How the cost of a frame grows: with the points of a scan, the frames of the window, the length of
// the drive (and so the map), and the threads. For each the exponent e of cost = c * quantity^e.
#pragma once

#include <Eigen/Core>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tools/benchmark/cases.h"

namespace lamina {

// The slope of the line through (log x, log y), by least squares. NaN unless two points at least
// have different x; points where x or y is not above 0 are left out.
double FitExponent(const std::vector<Eigen::Vector2d>& points);

struct ScalingCurve {
  std::string figure;                   // "cpu", "odometry", "peak RSS", ...
  std::vector<Eigen::Vector2d> points;  // quantity, and the median of the figure over the runs
};

struct ScalingStudy {
  std::string quantity;  // "points a scan"
  std::vector<ScalingCurve> curves;
};

struct ScalingOptions {
  std::vector<int> points{2000, 4000, 8000, 16000, 32000, 64000, 128000, 250000};
  std::vector<int> windows{5, 10, 20, 50, 100};
  std::vector<int> lengths{100, 200, 400, 800};
  std::vector<int> threads{1, 2};
  int frames = 40;  // of the studies of points and of threads
  int repetitions = 3;
  std::string lamina, folder;  // the program; where recordings and runs go

  // Throws OptionError: a number below 1.
  void Check() const;
};

// Runs of all studies, interleaved. `step` is called before each of them with what it is.
std::vector<ScalingStudy> StudyScaling(const ScalingOptions& options,
                                       const std::function<void(const std::string&)>& step);

// Markdown: the exponents, those above 1 in bold, and below them the figures.
std::string ScalingTable(const std::vector<ScalingStudy>& studies);
nlohmann::json ToJson(const std::vector<ScalingStudy>& studies);
// A panel for each study, both axes logarithmic.
std::string ScalingScript(const std::vector<ScalingStudy>& studies, const std::string& output_path);

}  // namespace lamina
