#include "tools/run/command.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <CLI/CLI.hpp>
#include <atomic>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "backend/calibration/opening_calibration.h"
#include "backend/loops/piece_loops.h"
#include "backend/mapping/mapping.h"
#include "backend/opening/map_thickness.h"
#include "backend/session/scan_record.h"
#include "config/config.h"
#include "core/base/error.h"
#include "core/base/printable_text.h"
#include "core/base/stopwatch.h"
#include "io/map/trajectory_io.h"
#include "io/points/scan_file.h"
#include "io/store/byte_file.h"
#include "io/store/tile_store.h"
#include "tools/cli/common.h"
#include "tools/cli/options.h"
#include "tools/results/keyframe_file.h"
#include "tools/results/output_folder.h"
#include "tools/results/piece_trajectories.h"
#include "tools/results/recording_part.h"
#include "tools/results/verdict/process_report.h"
#include "tools/run/beam_correction.h"
#include "tools/run/joined_run.h"
#include "tools/run/opening_choice.h"
#include "tools/run/opening_lines.h"
#include "tools/run/run_output.h"
#include "tools/run/thick_planes.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

void LogScan(const MappedScan& report, RunProgress* progress) {
  if (report.began_piece && report.piece > 0) progress->Warn(NewPieceMessage(report));
  if (report.skipped) {
    progress->WarnRepeated(std::string("skipped: ") + ToString(report.reason),
                           fmt::format("skipped scan {}: {}", report.index, report.detail));
  } else if (report.odometry.status == OdometryFrame::Status::kLost) {
    progress->WarnRepeated(
        "lost", fmt::format("lost at scan {}: {:.0f} % of its clusters agree with the map; kept "
                            "out of the map",
                            report.index, 100.0 * report.odometry.match.inlier_share));
  }
}

// Follows the memory of the map, and says once that it takes more than its budget.
void WatchMap(const VoxelMap& map, RunFigures* figures, RunProgress* progress) {
  figures->map_peak_bytes = std::max(figures->map_peak_bytes, map.bytes());
  if (figures->map_over_budget || !map.over_budget()) return;
  figures->map_over_budget = true;
  progress->Warn(fmt::format(
      "the map takes {:.1f} MB, over map.budget_mb={}: the frames of the window need all of it; "
      "raise the budget (to map_peak_bytes of summary.json) or lower backend.window.frames",
      static_cast<double>(map.bytes()) / 1048576.0, map.options().budget_mb));
}

void PrintSummary(const std::string& out, const MappingCounts& counts, const PieceErrors& errors,
                  const RunVerdict& verdict, const nlohmann::json& json) {
  fmt::print(
      "{} frames in {:.1f} s ({:.1f} frames/s, {:.1f} ms CPU a frame) after {:.1f} s of opening "
      "the recording, {} surfels\n",
      counts.frames, json["wall_s"].get<double>(), json.value("frames_per_s", 0.0),
      json.value("cpu_ms_per_frame", 0.0), json["opening_s"].get<double>(),
      json["map_surfels"].get<std::size_t>());
  if (json["skipped_scans"] > 0) fmt::print("skipped: {}\n", json["skipped_by_reason"].dump());
  if (counts.lost > 0) {
    fmt::print("lost on {} frames (status `lost` in frames.csv)\n", counts.lost);
  }
  std::size_t joined = 0;
  if (json.contains("loops")) joined = json["loops"]["pieces_joined"].get<std::size_t>();
  if (joined > 0)
    fmt::print("{} of {} pieces joined to earlier ones (`frame` in frames.csv)\n", joined,
               counts.pieces);
  if (counts.pieces > joined + 1) {
    fmt::print(
        "{} pieces that are not connected (`{}` in frames.csv): each has a frame of its own and "
        "files map_surfels_pieceN.ply and trajectory_tum_pieceN.txt\n",
        counts.pieces - joined, joined > 0 ? "frame" : "piece");
  }
  if (counts.degenerate > 0) {
    fmt::print("degenerate on {} frames: motion along unobservable directions is predicted\n",
               counts.degenerate);
  }
  if (json.contains("loops")) {
    const nlohmann::json& loops = json["loops"];
    fmt::print("{} submaps, {} loops accepted, {} that no other agrees with\n",
               loops["submaps"].dump(), loops["accepted"].dump(), loops["waiting"].dump());
  }
  if (!errors.empty()) fmt::print("{}", DescribePieceErrors(errors));
  fmt::print("verdict: {}\n", ToString(verdict));
  PrintOutputs(out);
}

// The map of the corrected submaps.
class CorrectedMap {
 public:
  CorrectedMap(const JoinedRun& run, const VoxelMapOptions& options, const std::string& scratch)
      : tiles_(scratch, TileStore::Lifetime::kScratch), map_(options, &tiles_) {
    run.AddTo(&map_);
  }
  const VoxelMap& map() const { return map_; }

 private:
  TileStore tiles_;
  VoxelMap map_;
};

// All that comes of mapping the recording once, with these options.
struct Attempt {
  Attempt(const RunArguments& arguments, const MappingOptions& options, const FrameRange& range)
      : output(arguments.out, options.mapper.frontend.matcher.max_iterations),
        progress(ProgressMode(arguments.progress), range.end - range.begin),
        tiles(output.Path("map_tiles.scratch"), TileStore::Lifetime::kScratch),
        submaps(output.Path("submaps.scratch"), ByteFile::Lifetime::kScratch),
        mapping(options, Callbacks(arguments), &tiles, &submaps) {}

  RunOutput output;
  RunProgress progress;
  RunFigures figures;
  TileStore tiles;
  ByteFile submaps;
  std::optional<KeyframeWriter> keyframes;
  std::int64_t scans_since_tidy = 0;
  Mapping mapping;

 private:
  // The file of this process alone: what is not needed now will not be.
  void TidySubmaps() {
    constexpr std::int64_t kScans = 3000;
    if (mapping.loops() == nullptr || ++scans_since_tidy % kScans != 0) return;
    submaps.KeepOnly(mapping.loops()->StoredPlaces());
  }

  MappingCallbacks Callbacks(const RunArguments& arguments) {
    MappingCallbacks callbacks;
    callbacks.on_scan = [this](const MappedScan& report) {
      output.Add(RecordOf(report));
      if (mapping.options().loops.enabled) output.AddLive(report);
      LogScan(report, &progress);
      WatchMap(mapping.map(), &figures, &progress);
      progress.Step();
      TidySubmaps();
    };
    callbacks.on_final_pose = [this](const FinalPose& pose) { output.Add(pose); };
    if (!arguments.keyframes) return callbacks;
    keyframes.emplace(output.Path(kKeyframeFileName));
    callbacks.on_final_keyframe = [this](std::int64_t piece, const FinalKeyframe& keyframe) {
      keyframes->Add(piece, keyframe);
    };
    return callbacks;
  }
};

LaminaConfig ConfigOf(const RunArguments& arguments, const std::string& file) {
  LaminaConfig config = LoadConfig(file, arguments.config.set);
  if (!arguments.loops.empty()) config.loops.enabled = arguments.loops == "on";
  return config;
}

// Says what was understood of the recording, and settles what it decides of the configuration.
void OpenRun(const ScanSource& source, const FrameRange& range, const RunArguments& arguments,
             const std::atomic<bool>& stop, LaminaConfig* config) {
  ShippedConfig shipped;
  if (arguments.config.file.empty())
    shipped = [&](const std::string& name) { return ConfigOf(arguments, name); };
  const OpeningChoice choice = ChooseOpening(source, range, *config, shipped, stop);
  *config = choice.config;
  const OpeningLines opening =
      DescribeOpening(source, range, *config, choice.fit, arguments.config.file);
  for (const std::string& line : opening.lines) {
    if (!arguments.quiet) fmt::print(stderr, "{}\n", Printable(line));
  }
  for (const std::string& doubt : opening.doubts) spdlog::warn("{}", doubt);
  for (const std::string& warning : choice.Warnings()) spdlog::warn("{}", warning);
}

// Nothing without a truth. Too few scans may have got poses for a comparison, which must not cost
// the run: then `problem` says so.
PieceErrors JudgeByTruth(const std::map<std::int64_t, Trajectory>& pieces, const Trajectory& truth,
                         std::string* problem) {
  if (truth.empty()) return {};
  try {
    return ComparePiecesWithTruth(pieces, truth);
  } catch (const InputError& error) {
    *problem = error.what();
    return {};
  }
}

// What is to be told when all is written. Returns the exit code.
int Tell(const RunArguments& arguments, const LaminaConfig& config, const Mapping& mapping,
         const OpeningCalibration& opening, const PieceErrors& errors, const RunVerdict& verdict,
         const nlohmann::json& summary) {
  LogBeamCorrection(opening);
  const std::string thick = ThickPlanesWarning(
      MeasureThickness(mapping.map(), config.backend.min_surfel_frames), config.Mapping());
  if (!thick.empty()) spdlog::warn("{}", thick);
  if (!arguments.quiet) PrintSummary(arguments.out, mapping.counts(), errors, verdict, summary);
  return verdict.grade == RunVerdict::Grade::kWrong ? kProbablyWrong : 0;
}

// Of opening a recording, and of mapping it.
class RunClock {
 public:
  void OpeningEnds() {
    opening_s_ = 1e-3 * watch_.Milliseconds();
    watch_ = Stopwatch();
    cpu_start_ = ProcessCpuSeconds();
  }
  void Stop(RunFigures* figures) const {
    figures->opening_s = opening_s_;
    figures->wall_s = 1e-3 * watch_.Milliseconds();
    figures->cpu_s = ProcessCpuSeconds() - cpu_start_;
  }

 private:
  Stopwatch watch_;
  double opening_s_ = 0.0, cpu_start_ = 0.0;
};

// Throws unless all scans were mapped, and one at least has a pose. `results`: what is in the
// folder now.
void ThrowUnlessWhole(const RunArguments& arguments, const FrameRange& range,
                      const MappedRecording& mapped, bool any_pose, const std::string& results) {
  if (mapped.processed < range.end - range.begin) {
    throw InterruptedError(fmt::format("{} of {} scans were mapped; {}", mapped.processed,
                                       range.end - range.begin, results));
  }
  if (!any_pose)
    throw InputError(fmt::format("{}: not one usable scan; {}", arguments.scans, results));
}

}  // namespace

int RunRecording(const RunArguments& arguments) {
  const auto limit = LimitThreads(arguments.threads);
  LaminaConfig config = ConfigOf(arguments, arguments.config.file);
  const auto source = OpenScans(arguments.scans, config.scans);
  const FrameRange range = ParseFrameRange(arguments.frames, source->size());
  RecordingPart part = PartOf(*source, range);
  Trajectory truth;
  if (!arguments.truth.empty()) truth = ReadTruthOfPart(arguments.truth, *source, part);
  CheckOutputFolder(arguments.out, arguments.scans);
  const bool replaces = HoldsResults(arguments.out);
  MakeDirectory(arguments.out);
  const std::atomic<bool>& stop = StopOnSignals();
  RunClock clock;
  OpenRun(*source, range, arguments, stop, &config);
  clock.OpeningEnds();
  std::optional<Attempt> attempt;
  const auto begin = [&](const MappingOptions& options) {
    attempt.reset();  // its files are those of the next one
    attempt.emplace(arguments, options, range);
    return &attempt->mapping;
  };
  const MappedRecording mapped = MapWithBeamCorrection(
      *source, range.begin, range.end, config.Mapping(), config.calibration, begin, &stop);
  config.preparation = mapped.mapping->options().preparation;
  RunOutput& output = attempt->output;
  RunFigures& figures = attempt->figures;
  Mapping& mapping = attempt->mapping;
  mapping.Finish();
  figures.interrupted = mapped.processed < range.end - range.begin;
  const bool any_pose = !output.Pieces().empty();
  if (replaces) {
    ThrowUnlessWhole(arguments, range, mapped, any_pose,
                     arguments.out + " keeps the results of an earlier run");
  }
  if (attempt->keyframes) attempt->keyframes->Commit();
  std::optional<CorrectedMap> corrected;
  std::optional<JoinedRun> joined;
  if (const PieceLoops* const loops = mapping.loops(); loops != nullptr) {
    joined.emplace(loops->pieces(), config);
    output.Correct(*joined);
    if (joined->moved())
      corrected.emplace(*joined, config.map, output.Path("map_corrected.scratch"));
  }
  attempt->progress.Finish();
  clock.Stop(&figures);

  std::string truth_problem;
  const PieceErrors errors = JudgeByTruth(output.Pieces(), truth, &truth_problem);
  // Of an interrupted run, the scans until then.
  if (mapped.processed > 0) part.end = part.begin + mapped.processed;
  const nlohmann::json summary =
      output.Finish(mapping.counts(), corrected ? corrected->map() : mapping.map(), config, part,
                    figures, errors, mapped.opening, joined ? &*joined : nullptr);
  if (!any_pose) ThrowUnlessWhole(arguments, range, mapped, any_pose, "summary.json says more");
  const int exit_code =
      Tell(arguments, config, mapping, mapped.opening, errors, output.Judge(), summary);
  ThrowUnlessWhole(arguments, range, mapped, any_pose, "the results are those of these");
  if (!truth_problem.empty()) throw InputError(truth_problem + " (all else is written)");
  return exit_code;
}

void AddRunCommand(CLI::App* app, std::function<int()>* run) {
  auto arguments = std::make_shared<RunArguments>();
  RunArguments& a = *arguments;
  CLI::App* command = app->add_subcommand(
      "run", "Estimate the pose of every scan of a recording and build its map");
  command
      ->add_option(
          "--scans", a.scans,
          "Recording: a ROS 1 bag, an MCAP file, a ROS 2 bag, a KITTI sequence (velodyne/, "
          "times.txt, calib.txt), a KITTI raw drive (velodyne_points/), a capture of packets "
          "(pcap, "
          "pcapng), or a folder of files of points (" +
              FolderPatterns() + "). `lamina info` says what is in one")
      ->required();
  command->add_option("--out", a.out, "Folder for the results; made if it is not there")
      ->required();
  AddTopicOption(command, &a.config);
  AddConfigOptions(
      command,
      ", e.g. kitti_raw; `lamina config default` explains every option. Without: "
      "livox_avia for a narrow view, handheld where scans see a small place, keyframes where "
      "they are thinned and far apart, livox_mid360 for few points all around without rings, else "
      "the defaults",
      &a.config);
  AddFramesOption(command, &a.frames);
  AddThreadsOption(command, "", &a.threads);
  command->add_option("--truth", a.truth,
                      "True trajectory, KITTI or TUM form, to report errors against. KITTI "
                      "odometry's poses/NN.txt may be given as it is: calib.txt's Tr is applied");
  command
      ->add_option(
          "--loops", a.loops,
          "Whether to find places that are visited again, and to correct map and trajectory by "
          "them; else as loops.enabled of the configuration, which is on")
      ->check(CLI::IsMember({"on", "off"}));
  AddProgressOption(command, &a.progress);
  command->callback([arguments, run] { *run = [arguments] { return RunRecording(*arguments); }; });
}

}  // namespace lamina
