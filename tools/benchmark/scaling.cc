#include "tools/benchmark/scaling.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <limits>
#include <map>

#include "config/config.h"
#include "core/base/error.h"
#include "io/recording/scan_source.h"
#include "tools/benchmark/figures.h"
#include "tools/benchmark/floor.h"
#include "tools/benchmark/measure.h"
#include "tools/plot/gnuplot.h"
#include "tools/results/verdict/process_report.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

// A place on the axis of a study, and what is run there.
struct ScalingPoint {
  std::size_t study = 0;
  double quantity = 0.0;  // known afterwards where it is measured
  BenchCase bench_case;
  int threads = 1;
  std::size_t frames = 0;
  BenchRow row;
};

enum StudyPlace { kPoints, kWindow, kMap, kThreads, kStudies };
constexpr const char* kQuantities[kStudies] = {"points a scan", "frames of the window",
                                               "voxels of the map", "threads"};

BenchCase Drive(const std::string& name, const std::string& synth, std::size_t frames) {
  return {name, "", "kitti_raw", {}, {synth, fmt::format("--frames {}", frames)}};
}

std::vector<ScalingPoint> PointsOf(const ScalingOptions& options) {
  std::vector<ScalingPoint> all;
  const auto add = [&](StudyPlace study, double quantity, BenchCase bench_case, int threads,
                       std::size_t frames) {
    all.push_back({study, quantity, std::move(bench_case), threads, frames, {}});
  };
  const auto frames = static_cast<std::size_t>(options.frames);
  for (const int points : options.points) {
    const std::string synth =
        fmt::format("--sensor spinning --scene street --sweep --points {}", points);
    add(kPoints, points, Drive(fmt::format("points_{}", points), synth, frames), 1, frames);
  }
  const std::string vlp16 = "--sensor vlp16 --scene street --sweep";
  // Long enough for the largest window to be full for as long as it took to fill it.
  for (const int window : options.windows) {
    const int most = *std::max_element(options.windows.begin(), options.windows.end());
    const auto length = static_cast<std::size_t>(2 * most);
    BenchCase drive = Drive(fmt::format("window_{}", length), vlp16, length);
    drive.set = {fmt::format("backend.window.frames={}", window)};
    add(kWindow, window, drive, 1, length);
  }
  for (const int length : options.lengths) {
    const int most = *std::max_element(options.lengths.begin(), options.lengths.end());
    add(kMap, length, Drive(fmt::format("map_{}", most), vlp16, static_cast<std::size_t>(most)), 1,
        static_cast<std::size_t>(length));
  }
  for (const int threads : options.threads) {
    add(kThreads, threads, Drive("threads", "--sensor hdl64 --scene street --sweep", frames),
        threads, frames);
  }
  return all;
}

// Stages, by CPU, over the second half of the scans: with a full window, in a map that has grown.
void AddScalingRun(const MeasuredRun& run, ScalingPoint* point) {
  AddRun(run, &point->row);
  const BenchFigure* const cpu = point->row.Find("cpu_ms");
  const double cpu_ms = cpu == nullptr ? std::nan("") : cpu->runs.back();
  const StageTimes stages = StageCpu(run.stages, run.stages.size() / 2, cpu_ms);
  double sum = 0.0;
  for (std::size_t k = 0; k < stages.size(); ++k) {
    point->row.Add(kBenchStages[k], "ms", stages[k]);
    sum += stages[k];
  }
  point->row.Add("all stages", "ms", sum);
  const nlohmann::json& voxels = run.summary.value("map_voxels", nlohmann::json());
  if (point->study == kMap && voxels.is_number()) point->quantity = voxels.get<double>();
}

void AddFloor(ScalingPoint* point) {
  const LaminaConfig config = LoadConfig(point->bench_case.config, point->bench_case.set);
  const auto source = OpenScans(point->bench_case.scans, config.scans);
  const Floor floor = MeasureFloor(*source, point->frames, config.map.LeafSize());
  point->row.Add("floor", "ms", floor.cpu_ms);
  if (point->study == kPoints) point->quantity = floor.points;
}

std::vector<ScalingStudy> Curves(const std::vector<ScalingPoint>& points) {
  std::vector<std::string> figures = {"cpu_ms", "wall_ms", "all stages"};
  figures.insert(figures.end(), kBenchStages.begin(), kBenchStages.end());
  figures.insert(figures.end(), {"floor", "peak_rss_mb", "map_mb"});
  std::vector<ScalingStudy> studies;
  for (std::size_t study = 0; study < kStudies; ++study) {
    ScalingStudy result{kQuantities[study], {}};
    for (const std::string& name : figures) {
      ScalingCurve curve{name, {}};
      for (const ScalingPoint& point : points) {
        const BenchFigure* const figure = point.row.Find(name);
        if (point.study == study && figure != nullptr)
          curve.points.emplace_back(point.quantity, SpreadOf(figure->runs).median);
      }
      if (!curve.points.empty()) result.curves.push_back(std::move(curve));
    }
    if (!result.curves.empty()) studies.push_back(std::move(result));
  }
  return studies;
}

std::string ExponentText(double exponent) {
  if (!std::isfinite(exponent)) return "-";
  // Within what a fit of a few measured points gives for what is linear.
  constexpr double kLinear = 1.05;
  return fmt::format(exponent > kLinear ? "**{:.2f}**" : "{:.2f}", exponent);
}

// Of a figure of the study; null if it has none.
const ScalingCurve* CurveOf(const ScalingStudy& study, const std::string& figure) {
  for (const ScalingCurve& curve : study.curves) {
    if (curve.figure == figure) return &curve;
  }
  return nullptr;
}

std::string StudyFigures(const ScalingStudy& study) {
  std::string head = fmt::format("| {} |", study.quantity), line = "|---|", text;
  for (const ScalingCurve& curve : study.curves) {
    head += fmt::format(" {} |", curve.figure);
    line += "---|";
  }
  const std::vector<Eigen::Vector2d>& places = study.curves.front().points;
  for (std::size_t i = 0; i < places.size(); ++i) {
    text += fmt::format("| {} |", FigureText(places[i].x()));
    for (const ScalingCurve& curve : study.curves) {
      text +=
          i < curve.points.size() ? fmt::format(" {} |", FigureText(curve.points[i].y())) : " - |";
    }
    text += "\n";
  }
  return head + "\n" + line + "\n" + text;
}

}  // namespace

double FitExponent(const std::vector<Eigen::Vector2d>& points) {
  std::vector<Eigen::Vector2d> logs;
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  for (const Eigen::Vector2d& p : points) {
    if (!p.allFinite() || p.minCoeff() <= 0.0) continue;
    logs.emplace_back(std::log(p.x()), std::log(p.y()));
    mean += logs.back();
  }
  mean /= static_cast<double>(logs.size());
  double xx = 0.0, xy = 0.0;
  for (const Eigen::Vector2d& p : logs) {
    xx += (p.x() - mean.x()) * (p.x() - mean.x());
    xy += (p.x() - mean.x()) * (p.y() - mean.y());
  }
  return xx > 0.0 ? xy / xx : std::numeric_limits<double>::quiet_NaN();
}

void ScalingOptions::Check() const {
  for (const auto* list : {&points, &windows, &lengths, &threads}) {
    for (const int value : *list) {
      if (value < 1)
        throw OptionError(
            fmt::format("--scaling: {} of {}: must be at least 1", value, fmt::join(*list, ",")));
    }
  }
}

std::vector<ScalingStudy> StudyScaling(const ScalingOptions& options,
                                       const std::function<void(const std::string&)>& step) {
  options.Check();
  std::vector<ScalingPoint> points = PointsOf(options);
  // Before minutes of measuring.
  for (const ScalingPoint& point : points)
    LoadConfig(point.bench_case.config, point.bench_case.set);
  for (ScalingPoint& point : points) {
    step(fmt::format("recording {}", point.bench_case.name));
    PrepareCase((fs::path(options.folder) / "scans" / point.bench_case.name).string(),
                &point.bench_case);
  }
  for (int i = 0; i < options.repetitions; ++i) {
    for (ScalingPoint& point : points) {
      step(fmt::format("{} {}, run {} of {}", kQuantities[point.study], point.quantity, i + 1,
                       options.repetitions));
      AddFloor(&point);
      AddScalingRun(MeasureRun(options.lamina, point.bench_case, point.threads, point.frames,
                               (fs::path(options.folder) / "run").string()),
                    &point);
    }
  }
  return Curves(points);
}

std::string ScalingTable(const std::vector<ScalingStudy>& studies) {
  std::vector<std::string> figures;
  std::string text =
      "Exponents; above 1.05 in bold. Stages: CPU ms a frame, second half of the scans.\n\n| of |";
  std::string line = "|---|";
  for (const ScalingStudy& study : studies) {
    text += fmt::format(" {}, {} to {} |", study.quantity,
                        FigureText(study.curves.front().points.front().x()),
                        FigureText(study.curves.front().points.back().x()));
    line += "---|";
    for (const ScalingCurve& curve : study.curves) {
      if (std::find(figures.begin(), figures.end(), curve.figure) == figures.end())
        figures.push_back(curve.figure);
    }
  }
  text += "\n" + line + "\n";
  for (const std::string& figure : figures) {
    text += fmt::format("| {} |", figure);
    for (const ScalingStudy& study : studies) {
      const ScalingCurve* const curve = CurveOf(study, figure);
      text +=
          fmt::format(" {} |", curve == nullptr ? "-" : ExponentText(FitExponent(curve->points)));
    }
    text += "\n";
  }
  for (const ScalingStudy& study : studies) text += "\n" + StudyFigures(study);
  return text;
}

nlohmann::json ToJson(const std::vector<ScalingStudy>& studies) {
  nlohmann::json json = nlohmann::json::array();
  for (const ScalingStudy& study : studies) {
    nlohmann::json curves = nlohmann::json::array();
    for (const ScalingCurve& curve : study.curves) {
      nlohmann::json points = nlohmann::json::array();
      for (const Eigen::Vector2d& p : curve.points) points.push_back({p.x(), p.y()});
      curves.push_back({{"figure", curve.figure},
                        {"exponent", NumberOrNull(FitExponent(curve.points))},
                        {"points", points}});
    }
    json.push_back({{"quantity", study.quantity}, {"curves", curves}});
  }
  return json;
}

std::string ScalingScript(const std::vector<ScalingStudy>& studies,
                          const std::string& output_path) {
  constexpr int kPanelWidth = 620, kPanelHeight = 460;
  const auto rows = static_cast<int>(studies.size() + 1) / 2;
  std::string script = GnuplotTerminal(output_path, 2 * kPanelWidth, kPanelHeight * rows);
  script += fmt::format("set output {}\nset multiplot layout {},2\nset logscale xy\nset grid\n",
                        GnuplotQuoted(output_path), rows);
  script += "set key outside right top\nset ylabel 'ms a frame'\n";
  int block = 0;
  for (const ScalingStudy& study : studies) {
    std::string plot;
    for (const ScalingCurve& curve : study.curves) {
      if (curve.figure == "peak_rss_mb" || curve.figure == "map_mb") continue;  // no ms
      script += fmt::format("$curve{} << EOD\n", block);
      for (const Eigen::Vector2d& p : curve.points)
        script += p.y() > 0.0 ? fmt::format("{:.6g} {:.6g}\n", p.x(), p.y()) : "\n";
      script += "EOD\n";
      const std::string title = fmt::format("{} {:.2f}", curve.figure, FitExponent(curve.points));
      plot += fmt::format("{}$curve{} using 1:2 with linespoints linewidth 2 title {}",
                          plot.empty() ? "plot " : ", ", block, GnuplotQuoted(title));
      ++block;
    }
    script += fmt::format("set xlabel {}\n{}\n", GnuplotQuoted(study.quantity), plot);
  }
  return script + "unset multiplot\nunset output\n";
}

}  // namespace lamina
