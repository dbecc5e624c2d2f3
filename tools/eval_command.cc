#include "tools/eval_command.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "config/config.h"
#include "core/error.h"
#include "core/trajectory_metrics.h"
#include "io/file_writer.h"
#include "io/scan_source.h"
#include "io/trajectory_io.h"
#include "tools/command_options.h"
#include "tools/eval_match.h"
#include "tools/eval_plots.h"
#include "tools/eval_report.h"
#include "tools/map_quality.h"
#include "tools/piece_poses.h"
#include "tools/plot.h"
#include "tools/posed_scans.h"

namespace lamina {
namespace {

struct EvalArguments {
  std::string estimate;
  std::vector<std::string> others;  // NAME=FILE
  std::string truth;
  std::string calib;
  std::string align = "se3";
  double tolerance_s = 0.01;
  std::string scans;
  ConfigArguments config;
  std::string json;
  std::string plot;
  std::string plot_format = "svg";
};

Alignment AlignmentOf(const std::string& name) {
  static const std::map<std::string, Alignment> names{
      {"se3", Alignment::kSe3}, {"first", Alignment::kFirst}, {"none", Alignment::kNone}};
  return names.at(name);
}

void CheckArguments(const EvalArguments& a) {
  if (a.truth.empty() && a.scans.empty()) {
    throw OptionError("eval: nothing to judge by: give --truth, --scans, or both");
  }
  if (!a.calib.empty() && a.truth.empty()) {
    throw OptionError("eval: --calib is for the poses of --truth, which is missing");
  }
  if (a.scans.empty() && !(a.config.file.empty() && a.config.set.empty())) {
    throw OptionError("eval: --config and --set say how to read --scans, which is missing");
  }
  if (!(a.tolerance_s >= 0.0 && a.tolerance_s <= 1e3)) {
    throw OptionError(
        fmt::format("eval: --tolerance is {}, must be in [0, 1000] s", a.tolerance_s));
  }
}

// A trajectory, or each of its pieces: what is not connected must not be aligned as one.
void AddEstimate(const std::string& name, const std::string& path,
                 const std::vector<StampNs>& stamps, std::vector<NamedTrajectory>* estimates) {
  const Trajectory all = ReadTrajectory(path, stamps);
  const std::map<std::int64_t, Trajectory> pieces = SplitIntoPieces(path, all);
  if (pieces.size() == 1) return estimates->push_back({name, all});
  fmt::print("{}: {} pieces that are not connected; each is judged by itself\n", name,
             pieces.size());
  for (const auto& [piece, poses] : pieces) {
    estimates->push_back({fmt::format("{} piece {}", name, piece), poses});
  }
}

// The trajectories to judge, the one of --estimate first.
std::vector<NamedTrajectory> ReadEstimates(const EvalArguments& a,
                                           const std::vector<StampNs>& stamps) {
  std::vector<NamedTrajectory> estimates;
  AddEstimate("estimate", a.estimate, stamps, &estimates);
  for (const std::string& other : a.others) {
    const size_t equals = other.find('=');
    if (equals == 0 || equals == std::string::npos || equals + 1 == other.size()) {
      throw OptionError("eval: --other is '" + other + "', must be NAME=FILE");
    }
    AddEstimate(other.substr(0, equals), other.substr(equals + 1), stamps, &estimates);
  }
  return estimates;
}

std::vector<ComparedTrajectory> JudgeByTruth(const EvalArguments& a,
                                             const std::vector<StampNs>& stamps,
                                             const std::vector<NamedTrajectory>& estimates,
                                             nlohmann::json* json) {
  const Trajectory truth = ReadTruth(a.truth, a.calib, stamps);
  const Alignment alignment = AlignmentOf(a.align);
  std::vector<ComparedTrajectory> compared;
  nlohmann::json list = nlohmann::json::array();
  const bool pieces = estimates.size() > 1 + a.others.size();
  std::string problem;
  for (const NamedTrajectory& estimate : estimates) {
    try {
      compared.push_back(MatchToTruth(estimate, truth, a.tolerance_s));
    } catch (const InputError& error) {
      // A piece may be too short, or where the truth has a gap.
      if (!pieces) throw;
      problem = error.what();
      fmt::print("{}: not judged: {}\n", estimate.name, problem);
      list.push_back({{"name", estimate.name}, {"not_judged", problem}});
      continue;
    }
    const ComparedTrajectory& c = compared.back();
    const TrajectoryErrors errors = CompareTrajectories(c.estimate, c.truth, alignment);
    const std::string how =
        HasStamps(truth) ? fmt::format("by stamp within {} s", a.tolerance_s) : "by line number";
    fmt::print("{}: {} poses, truth: {} poses, matched {}\n{}\n", estimate.name,
               estimate.poses.size(), truth.size(), how, DescribeErrors(errors, alignment));
    list.push_back(ToJson(errors, alignment));
    list.back()["name"] = estimate.name;
    list.back()["matched"] = how;
  }
  if (compared.empty()) throw InputError(problem);
  (*json)["truth"] = list;
  return compared;
}

void JudgeByMap(const ScanSource& scans, const LaminaConfig& config, double tolerance_s,
                const std::vector<NamedTrajectory>& estimates, bool pieces, nlohmann::json* json) {
  MapQualityOptions options;
  options.preparation = config.preparation;
  options.frame_period_s = config.scans.frame_period_s;
  options.stamp_tolerance_s = tolerance_s;
  const auto judge = [&](const std::vector<NamedTrajectory>& together) {
    const MapQualityReport report = MeasureMapQuality(scans, together, options);
    fmt::print("{}", DescribeMapQuality(report, options));
    return ToJson(report, options);
  };
  if (!pieces) {
    (*json)["map_quality"] = judge(estimates);
    return;
  }
  // Pieces have no scans in common.
  (*json)["map_quality"] = nlohmann::json::array();
  for (const NamedTrajectory& estimate : estimates) {
    (*json)["map_quality"].push_back(judge({estimate}));
  }
}

// DIR/ (or an existing directory) to DIR/top.svg, PREFIX to PREFIX_top.svg.
std::string PicturePath(const EvalArguments& a, const std::string& name) {
  const bool folder = a.plot.back() == '/' || std::filesystem::is_directory(a.plot);
  if (!folder) return a.plot + "_" + name + "." + a.plot_format;
  std::error_code error;
  std::filesystem::create_directories(a.plot, error);
  if (error) throw OutputError("cannot make the folder " + a.plot + ": " + error.message());
  return (std::filesystem::path(a.plot) / (name + "." + a.plot_format)).string();
}

void DrawPictures(const EvalArguments& a, const std::vector<NamedTrajectory>& estimates,
                  const std::vector<ComparedTrajectory>& compared) {
  const Alignment alignment = AlignmentOf(a.align);
  std::vector<NamedTrajectory> paths;
  // With a truth, what is shown is what was compared: matched and aligned.
  if (!compared.empty()) paths.push_back({"truth", compared.front().truth});
  for (const ComparedTrajectory& c : compared) {
    const SE3 T = AlignTrajectories(c.estimate, c.truth, alignment);
    paths.push_back({c.name, c.estimate});
    for (StampedPose& pose : paths.back().poses) pose.T_world_lidar = T * pose.T_world_lidar;
  }
  if (compared.empty()) paths = estimates;
  std::vector<std::string> written{PicturePath(a, "top")};
  WritePlot(TopViewPlot(paths), written.back());
  if (!compared.empty()) {
    written.push_back(PicturePath(a, "error"));
    WritePlot(ErrorPlot(compared, alignment), written.back());
  }
  for (const std::string& path : written) fmt::print("wrote {}\n", path);
}

int RunEval(const EvalArguments& a) {
  CheckArguments(a);
  LaminaConfig config;
  std::unique_ptr<ScanSource> scans;
  std::vector<StampNs> stamps;
  if (!a.scans.empty()) {
    config = LoadConfig(a.config.file, a.config.set);
    scans = OpenScans(a.scans, config.scans);
    stamps = ScanStamps(*scans);
  }
  const std::vector<NamedTrajectory> estimates = ReadEstimates(a, stamps);
  nlohmann::json json;
  std::vector<ComparedTrajectory> compared;
  if (!a.truth.empty()) compared = JudgeByTruth(a, stamps, estimates, &json);
  const bool pieces = estimates.size() > 1 + a.others.size();
  if (scans != nullptr) JudgeByMap(*scans, config, a.tolerance_s, estimates, pieces, &json);
  if (!a.json.empty()) {
    FileWriter writer(a.json);
    writer.Write(json.dump(2) + "\n");
    writer.Commit();
  }
  if (!a.plot.empty()) DrawPictures(a, estimates, compared);
  return 0;
}

void AddTruthOptions(CLI::App* command, EvalArguments* a) {
  command
      ->add_option("--truth", a->truth,
                   "True trajectory, TUM or KITTI form: prints APE, RPE and segment errors. "
                   "Poses are matched by stamp, or by line number if neither file has stamps")
      ->type_name("FILE");
  command
      ->add_option("--calib", a->calib,
                   "calib.txt of KITTI odometry, for a truth that holds poses of the camera; "
                   "its Tr turns them into poses of the LiDAR")
      ->type_name("FILE");
  command
      ->add_option("--align", a->align,
                   "Alignment before APE: se3 (least squares, no scale), first (first poses made "
                   "equal) or none")
      ->check(CLI::IsMember({"se3", "first", "none"}))
      ->capture_default_str();
  command
      ->add_option("--tolerance", a->tolerance_s, "Stamps that differ by no more belong together")
      ->type_name("SECONDS")
      ->capture_default_str();
}

void AddScanOptions(CLI::App* command, EvalArguments* a) {
  command
      ->add_option("--scans", a->scans,
                   "The recording: prints the quality of the maps that the trajectories build "
                   "from it. It also lends its stamps to KITTI pose files")
      ->type_name("PATH");
  AddConfigOptions(command, "; what counts is how scans are read, deskewed and corrected",
                   &a->config);
}

}  // namespace

void AddEvalCommand(CLI::App* app, std::function<int()>* run) {
  CLI::App* command = app->add_subcommand(
      "eval", "Judge trajectories, by a true one (--truth) or by their maps (--scans)");
  auto arguments = std::make_shared<EvalArguments>();
  command
      ->add_option("--estimate", arguments->estimate,
                   "Trajectory to judge, TUM or KITTI form, poses of the LiDAR")
      ->type_name("FILE")
      ->required();
  command
      ->add_option("--other", arguments->others,
                   "One more trajectory to judge beside it. May be given again")
      ->type_name("NAME=FILE")
      ->allow_extra_args(false);
  AddTruthOptions(command, arguments.get());
  AddScanOptions(command, arguments.get());
  command->add_option("--json", arguments->json, "Write all figures to this file, too")
      ->type_name("FILE");
  command
      ->add_option("--plot", arguments->plot,
                   "Draw the paths from above and, with --truth, the error along the way: into "
                   "this directory (exists or ends in /), else to files that begin so. Needs "
                   "gnuplot")
      ->type_name("PREFIX");
  command->add_option("--plot-format", arguments->plot_format, "Kind of the pictures")
      ->check(CLI::IsMember({"svg", "png"}))
      ->capture_default_str();
  command->callback([arguments, run] { *run = [arguments] { return RunEval(*arguments); }; });
}

}  // namespace lamina
