#include "tools/eval/command.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "config/config.h"
#include "core/base/error.h"
#include "io/file/file_writer.h"
#include "io/map/trajectory_io.h"
#include "io/recording/scan_source.h"
#include "tools/cli/options.h"
#include "tools/eval/plots.h"
#include "tools/eval/report.h"
#include "tools/metrics/map_quality.h"
#include "tools/metrics/match.h"
#include "tools/metrics/trajectory_metrics.h"
#include "tools/plot/gnuplot.h"
#include "tools/results/output_folder.h"
#include "tools/results/piece_poses.h"
#include "tools/results/posed_scans.h"
#include "tools/results/recording_part.h"

namespace lamina {
namespace {

struct EvalArguments {
  std::string estimate;
  std::vector<std::string> others;  // NAME=FILE
  std::string truth;
  std::string calib;
  std::string align = "se3";
  double tolerance_s = kStampToleranceS;
  std::string scans, frames;
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

// The scans that the poses are of, as far as they are known.
struct PosedPart {
  std::optional<RecordingPart> part;
  std::vector<StampNs> stamps;  // of the whole recording, if that is there
};

// Out of the recording; without it out of --frames, which counts the truth's poses then; without
// that out of the folder of the run that the estimate lies in.
PosedPart FindPart(const EvalArguments& a, const ScanSource* scans) {
  if (scans != nullptr) {
    return {PartOf(*scans, ParseFrameRange(a.frames, scans->size())), ScanStamps(*scans)};
  }
  if (!a.frames.empty()) {
    const std::size_t size = ReadTrajectory(a.truth).size();
    const FrameRange range = ParseFrameRange(a.frames, size);
    return {RecordingPart{size, range.begin, range.end, std::nullopt, {}}, {}};
  }
  const auto part = ReadRecordingPart(std::filesystem::path(a.estimate).parent_path().string());
  // The file may have come there from elsewhere.
  if (part && ReadTrajectory(a.estimate).size() == part->size()) return {part, {}};
  return {};
}

Trajectory ReadPoses(const std::string& path, const PosedPart& posed,
                     std::size_t* first_line = nullptr) {
  return posed.part ? ReadPosesOfPart(path, *posed.part, posed.stamps, first_line)
                    : ReadTrajectory(path);
}

// A trajectory to judge and its pieces: what is not connected must not be aligned as one.
struct Estimate {
  NamedTrajectory whole;
  std::vector<NamedTrajectory> pieces;  // the whole, if that is one
};

Estimate ReadEstimate(const std::string& name, const std::string& path, const PosedPart& posed) {
  std::size_t first_line = 0;
  Estimate estimate{{name, ReadPoses(path, posed, &first_line)}, {}};
  const auto pieces = SplitIntoPieces(path, estimate.whole.poses, first_line);
  if (pieces.size() == 1) {
    estimate.pieces.push_back(estimate.whole);
    return estimate;
  }
  fmt::print("{}: {} pieces that are not connected; each is judged by itself\n", name,
             pieces.size());
  for (const auto& [piece, poses] : pieces) {
    estimate.pieces.push_back({fmt::format("{} piece {}", name, piece), poses});
  }
  return estimate;
}

// The trajectories to judge, the one of --estimate first.
std::vector<Estimate> ReadEstimates(const EvalArguments& a, const PosedPart& posed) {
  std::vector<Estimate> estimates{ReadEstimate("estimate", a.estimate, posed)};
  for (const std::string& other : a.others) {
    const size_t equals = other.find('=');
    if (equals == 0 || equals == std::string::npos || equals + 1 == other.size()) {
      throw OptionError("eval: --other is '" + other + "', must be NAME=FILE");
    }
    estimates.push_back(ReadEstimate(other.substr(0, equals), other.substr(equals + 1), posed));
  }
  return estimates;
}

std::vector<NamedTrajectory> PiecesOf(const std::vector<Estimate>& estimates) {
  std::vector<NamedTrajectory> pieces;
  for (const Estimate& estimate : estimates) {
    pieces.insert(pieces.end(), estimate.pieces.begin(), estimate.pieces.end());
  }
  return pieces;
}

std::vector<ComparedTrajectory> JudgeByTruth(const EvalArguments& a, const PosedPart& posed,
                                             const std::vector<Estimate>& estimates,
                                             nlohmann::json* json) {
  const Trajectory truth = WithCalibration(ReadPoses(a.truth, posed), a.calib);
  const Alignment alignment = AlignmentOf(a.align);
  std::vector<ComparedTrajectory> compared;
  nlohmann::json list = nlohmann::json::array();
  const std::string how =
      HasStamps(truth) ? fmt::format("by stamp within {} s", a.tolerance_s) : "by line number";
  std::string problem;
  const auto judge = [&](const NamedTrajectory& poses, bool is_piece) {
    try {
      compared.push_back(MatchPart(poses, truth, a.tolerance_s));
    } catch (const InputError& error) {
      // A piece may be too short, or where the truth has a gap.
      if (!is_piece) throw;
      problem = error.what();
      fmt::print("{}: not judged: {}\n", poses.name, problem);
      list.push_back({{"name", poses.name}, {"not_judged", problem}});
      return;
    }
    const TrajectoryErrors errors = ErrorsOf(compared.back(), alignment);
    fmt::print("{}: {} poses, truth: {} poses, matched {}\n{}\n", poses.name, poses.poses.size(),
               truth.size(), how, DescribeErrors(errors, alignment));
    list.push_back(ToJson(errors, alignment));
    list.back()["name"] = poses.name;
    list.back()["matched"] = how;
  };
  for (const Estimate& estimate : estimates) {
    RequireMatchable(estimate.whole, truth);
    for (const NamedTrajectory& piece : estimate.pieces) judge(piece, estimate.pieces.size() > 1);
  }
  if (compared.empty()) throw InputError(problem);
  (*json)["truth"] = list;
  return compared;
}

// Of poses of another recording few have a scan, and these by chance.
void RequireScans(const ScanSource& scans, double tolerance_s,
                  const std::vector<Estimate>& estimates) {
  for (const auto& [whole, pieces] : estimates) {
    const std::size_t posed = PoseScans(scans, whole.poses, tolerance_s).size();
    if (2 * posed >= whole.poses.size()) continue;
    throw InputError(fmt::format(
        "{}: {} of its {} poses have the stamp of one of the {} scans: is it another recording?",
        whole.name, posed, whole.poses.size(), scans.size()));
  }
}

void JudgeByMap(const ScanSource& scans, const LaminaConfig& config, double tolerance_s,
                const std::vector<NamedTrajectory>& pieces, bool apart, nlohmann::json* json) {
  MapQualityOptions options;
  options.preparation = config.preparation;
  options.frame_period_s = config.scans.frame_period_s;
  options.stamp_tolerance_s = tolerance_s;
  const auto judge = [&](const std::vector<NamedTrajectory>& together) {
    const MapQualityReport report = MeasureMapQuality(scans, together, options);
    fmt::print("{}", DescribeMapQuality(report, options));
    return ToJson(report, options);
  };
  if (!apart) {
    (*json)["map_quality"] = judge(pieces);
    return;
  }
  // Pieces have no scans in common.
  (*json)["map_quality"] = nlohmann::json::array();
  for (const NamedTrajectory& piece : pieces) {
    (*json)["map_quality"].push_back(judge({piece}));
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

// As the run whose trajectory is judged has read and deskewed its scans, unless it is said how.
LaminaConfig ConfigOf(const EvalArguments& a) {
  const std::filesystem::path of_run =
      std::filesystem::path(a.estimate).parent_path() / "config.yaml";
  if (a.config.file.empty() && std::filesystem::exists(of_run)) {
    try {
      return LoadConfig(of_run.string(), a.config.set);
    } catch (const OptionError& error) {
      // It may be none of this program, or of another version.
      spdlog::warn("{}; scans are read by the default configuration", error.what());
    }
  }
  return LoadConfig(a.config.file, a.config.set);
}

int RunEval(const EvalArguments& given) {
  EvalArguments a = given;
  // Of a run or a session, the poses with their stamps.
  if (std::filesystem::is_directory(a.estimate))
    a.estimate = (std::filesystem::path(a.estimate) / "trajectory_tum.txt").string();
  CheckArguments(a);
  LaminaConfig config;
  std::unique_ptr<ScanSource> scans;
  if (!a.scans.empty()) {
    config = ConfigOf(a);
    scans = OpenScans(a.scans, config.scans);
  }
  const PosedPart posed = FindPart(a, scans.get());
  const std::vector<Estimate> estimates = ReadEstimates(a, posed);
  if (scans != nullptr) RequireScans(*scans, a.tolerance_s, estimates);
  nlohmann::json json;
  std::vector<ComparedTrajectory> compared;
  if (!a.truth.empty()) compared = JudgeByTruth(a, posed, estimates, &json);
  const std::vector<NamedTrajectory> pieces = PiecesOf(estimates);
  const bool apart = pieces.size() > estimates.size();
  if (scans != nullptr) JudgeByMap(*scans, config, a.tolerance_s, pieces, apart, &json);
  if (!a.json.empty()) {
    CheckReplacesNoResult("--json", a.json);
    FileWriter writer(a.json);
    writer.Write(json.dump(2) + "\n");
    writer.Commit();
  }
  if (!a.plot.empty()) DrawPictures(a, pieces, compared);
  return 0;
}

void AddTruthOptions(CLI::App* command, EvalArguments* a) {
  command
      ->add_option("--truth", a->truth,
                   "True trajectory, TUM or KITTI form: prints APE, RPE and segment errors. "
                   "Poses are matched by stamp, or by line number if neither file has stamps: "
                   "then there must be as many in both")
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
  AddTopicOption(command, &a->config);
  AddConfigOptions(command,
                   "; what counts is how scans are read, deskewed and corrected. Default: the "
                   "config.yaml beside --estimate",
                   &a->config);
}

}  // namespace

void AddEvalCommand(CLI::App* app, std::function<int()>* run) {
  CLI::App* command = app->add_subcommand(
      "eval", "Judge trajectories, by a true one (--truth) or by their maps (--scans)");
  auto arguments = std::make_shared<EvalArguments>();
  command
      ->add_option("--estimate", arguments->estimate,
                   "Trajectory to judge, TUM or KITTI form, poses of the LiDAR; of the folder of a "
                   "run, its trajectory_tum.txt")
      ->type_name("FILE|DIR")
      ->required();
  command
      ->add_option("--other", arguments->others,
                   "One more trajectory to judge beside it. May be given again")
      ->type_name("NAME=FILE")
      ->allow_extra_args(false);
  AddTruthOptions(command, arguments.get());
  AddScanOptions(command, arguments.get());
  command
      ->add_option("--frames", arguments->frames,
                   "What the estimate is of: scans A to B-1 of the recording, counted from 0, or "
                   "of those that the truth has poses for. Not needed for results of `run`")
      ->type_name("A:B");
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
