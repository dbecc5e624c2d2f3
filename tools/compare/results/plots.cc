#include "tools/compare/results/plots.h"

#include <fmt/format.h>

#include <algorithm>

#include "tools/compare/methods.h"
#include "tools/plot/gnuplot.h"

namespace lamina {
namespace {

// Mean over the sequences that have one.
std::vector<double> MeanDistribution(const CompareTable& table, const std::string& method) {
  std::vector<double> mean;
  double count = 0.0;
  for (const CompareColumn& column : table.columns) {
    const auto found = column.cells.find(method);
    if (found == column.cells.end() || !found->second.row.structure) continue;
    const std::vector<double>& shares = found->second.row.structure->distribution;
    mean.resize(shares.size());
    for (std::size_t i = 0; i < shares.size(); ++i) mean[i] += shares[i];
    count += 1.0;
  }
  for (double& share : mean) share /= count;
  return mean;
}

}  // namespace

void DrawStructuralErrors(const std::string& path, const CompareTable& table) {
  Plot plot;
  plot.title = "Distance of map points to the true surfaces (" + table.title + ")";
  plot.x_label = "distance [cm]";
  plot.y_label = "share of the points within [%]";
  for (const std::string& method : table.methods) {
    const std::vector<double> shares = MeanDistribution(table, method);
    if (shares.empty()) continue;
    PlotSeries series{FindMethod(method).title, {}};
    double sum = 0.0;
    const double bin_cm = 5.0 / static_cast<double>(shares.size() - 1);
    for (std::size_t i = 0; i + 1 < shares.size(); ++i) {
      sum += shares[i];
      series.points.emplace_back(bin_cm * static_cast<double>(i + 1), 100.0 * sum);
    }
    plot.series.push_back(std::move(series));
  }
  if (!plot.series.empty()) WritePlot(plot, path);
}

void DrawResolutionStudy(const std::string& path, const std::vector<ResolutionPoint>& points) {
  std::vector<std::string> curves;
  for (const ResolutionPoint& p : points) {
    if (std::find(curves.begin(), curves.end(), p.curve) == curves.end()) curves.push_back(p.curve);
  }
  const auto script = [&](const std::string& output) {
    std::string text = GnuplotTerminal(output, 1100, 460);
    text += fmt::format("set output {}\nset multiplot layout 1,2\n", GnuplotQuoted(output));
    for (std::size_t k = 0; k < curves.size(); ++k) {
      text += fmt::format("$curve{} << EOD\n", k);
      for (const ResolutionPoint& p : points) {
        if (p.curve != curves[k]) continue;
        text += fmt::format("{:.6g} {:.6g} {:.6g}\n", p.resolution_m, p.ape_cm, p.solve_ms);
      }
      text += "EOD\n";
    }
    text +=
        "set grid\nset logscale xy\nset xlabel 'resolution of the input [m]'\nset key top right\n";
    for (const int column : {2, 3}) {
      text += column == 2 ? "set ylabel 'APE [cm]'\n" : "set ylabel 'solve time [ms]'\n";
      text += "plot ";
      for (std::size_t k = 0; k < curves.size(); ++k) {
        text += fmt::format("{}$curve{} using 1:{} with linespoints linewidth 2 title {}",
                            k == 0 ? "" : ", ", k, column, GnuplotQuoted(curves[k]));
      }
      text += "\n";
    }
    return text + "unset multiplot\nunset output\n";
  };
  DrawPicture(script, path);
}

}  // namespace lamina
