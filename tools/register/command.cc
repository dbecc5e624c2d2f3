#include "tools/register/command.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "backend/bundle/formulations/registry.h"
#include "backend/mapping/scan_decoder.h"
#include "backend/registration/batch_registration.h"
#include "config/config.h"
#include "core/base/error.h"
#include "core/base/parallel.h"
#include "core/base/stopwatch.h"
#include "io/map/map_io.h"
#include "io/map/trajectory_io.h"
#include "tools/cli/common.h"
#include "tools/cli/options.h"
#include "tools/metrics/match.h"
#include "tools/register/report.h"
#include "tools/results/output_folder.h"
#include "tools/results/recording_part.h"
#include "tools/results/run_summary.h"
#include "tools/results/verdict/process_report.h"
#include "tools/results/verdict/verdict.h"

namespace lamina {
namespace {

struct RegisterArguments {
  std::string scans, initial, out, frames, truth;
  std::string formulation = CondensedFormulation().name;
  std::string progress = "auto";
  ConfigArguments config;
  int threads = 0;
};

// The pose at a stamp of poses that ascend in time: its own, or between those before and after it;
// none before the first and after the last.
std::optional<SE3> PoseAt(const Trajectory& poses, StampNs stamp_ns) {
  const auto after = std::lower_bound(
      poses.begin(), poses.end(), stamp_ns,
      [](const StampedPose& pose, StampNs stamp) { return pose.stamp_ns < stamp; });
  const auto at = [&](Trajectory::const_iterator pose) {
    return std::abs(static_cast<double>(pose->stamp_ns - stamp_ns)) <= 1e9 * kStampToleranceS;
  };
  if (after != poses.end() && at(after)) return after->T_world_lidar;
  if (after != poses.begin() && at(after - 1)) return (after - 1)->T_world_lidar;
  if (after == poses.begin() || after == poses.end()) return std::nullopt;
  const StampedPose &from = *(after - 1), &to = *after;
  return Interpolate(from.T_world_lidar, to.T_world_lidar,
                     static_cast<double>(stamp_ns - from.stamp_ns) /
                         static_cast<double>(to.stamp_ns - from.stamp_ns));
}

// By their stamps.
std::vector<std::optional<SE3>> PosesAtScans(const std::string& path, Trajectory poses,
                                             const ScanSource& source, const FrameRange& range) {
  std::stable_sort(poses.begin(), poses.end(), [](const StampedPose& a, const StampedPose& b) {
    return a.stamp_ns < b.stamp_ns;
  });
  std::vector<std::optional<SE3>> initial;
  for (std::size_t i = range.begin; i < range.end; ++i) {
    initial.push_back(PoseAt(poses, source.Stamp(i)));
  }
  if (std::all_of(initial.begin(), initial.end(), [](const auto& p) { return !p; })) {
    throw InputError(fmt::format(
        "{}: no scan has its stamp among those of the poses; poses without stamps (KITTI "
        "form) are taken in order",
        path));
  }
  return initial;
}

// A pose for each scan of the range: by stamp, where poses and scans have stamps, and a scan may be
// left without; else in order, if there are as many as scans in the recording or in the range.
std::vector<std::optional<SE3>> ReadInitialPoses(const std::string& path, const ScanSource& source,
                                                 const FrameRange& range) {
  const Trajectory poses = CameraToLidar(ReadTrajectory(path), source.T_camera_lidar());
  const std::size_t wanted = range.end - range.begin;
  if (HasStamps(poses) && source.recorded_stamps()) return PosesAtScans(path, poses, source, range);
  if (poses.size() != source.size() && poses.size() != wanted) {
    std::string advice;
    if (poses.size() < wanted) {
      advice = fmt::format("; if they are those of the first scans, add --frames {}:{}",
                           range.begin, range.begin + poses.size());
    }
    throw InputError(
        fmt::format("{}: holds {} poses for {} scans, and no stamps tell which scan each is of{}",
                    path, poses.size(), wanted, advice));
  }
  const std::size_t first = poses.size() == source.size() ? range.begin : 0;
  std::vector<std::optional<SE3>> initial;
  for (std::size_t i = 0; i < wanted; ++i) initial.push_back(poses[first + i].T_world_lidar);
  return initial;
}

// The poses of scans without one, which are left out: those of the last before, or the first.
std::vector<SE3> Filled(const std::vector<std::optional<SE3>>& poses) {
  SE3 last =
      **std::find_if(poses.begin(), poses.end(), [](const auto& p) { return p.has_value(); });
  std::vector<SE3> filled;
  for (const std::optional<SE3>& pose : poses) filled.push_back(last = pose.value_or(last));
  return filled;
}

// Takes poses that lie far from the origin, as those of a national grid do, to one of the map's
// near by, which is returned: whole metres, zero where floats of the map's file are exact to a
// millimetre.
Eigen::Vector3d MoveToMapOrigin(std::vector<std::optional<SE3>>* poses) {
  constexpr double kFarM = 8000.0;
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  double far_m = 0.0;
  for (auto pose = poses->rbegin(); pose != poses->rend(); ++pose) {
    if (!*pose) continue;
    origin = (*pose)->t.array().round();
    far_m = std::max(far_m, (*pose)->t.cwiseAbs().maxCoeff());
  }
  if (far_m <= kFarM) return Eigen::Vector3d::Zero();
  for (std::optional<SE3>& pose : *poses) {
    if (pose) pose->t -= origin;
  }
  return origin;
}

struct Batch {
  std::vector<BatchFrame> frames;
  std::vector<std::size_t> scans;  // of each frame, in the recording
  std::size_t skipped = 0;
};

// Takes a scan into the batch, if it can be used; its points go, unless they are needed.
void Take(DecodedScan scan, const std::optional<SE3>& initial, const Formulation& formulation,
          double leaf_m, RunProgress* progress, Batch* batch) {
  const MappedScan& report = scan.report;
  if (report.skipped || !initial) {
    ++batch->skipped;
    progress->Warn(fmt::format("skipped scan {}: {}", report.index,
                               report.skipped ? report.detail : "it has no initial pose"));
    return;
  }
  BatchFrame frame;
  frame.stamp_ns = report.stamp_ns;
  frame.T_world_lidar = *initial;
  if (formulation.needs_points) frame.points = GroupByCluster(scan.points, leaf_m);
  frame.clusters = scan.clusters;
  batch->frames.push_back(std::move(frame));
  batch->scans.push_back(report.index);
}

// Reads all scans of the range. What cannot be used is reported and left out.
Batch ReadBatch(const ScanSource& source, const FrameRange& range, const LaminaConfig& config,
                const Formulation& formulation, const std::vector<std::optional<SE3>>& poses,
                const std::atomic<bool>& stop, RunProgress* progress) {
  const double leaf_m = config.map.LeafSize();
  // Some at once, so that the bar moves and Ctrl-C is heard.
  constexpr std::size_t kAtOnce = 16;
  Batch batch;
  for (std::size_t begin = range.begin; begin < range.end && !stop; begin += kAtOnce) {
    std::vector<DecodedScan> decoded(std::min(kAtOnce, range.end - begin));
    ParallelChunks(decoded.size(), 1, [&](std::size_t a, std::size_t b) {
      for (std::size_t i = a; i < b; ++i) {
        decoded[i] = DecodeScan(source, config.preparation, config.pipeline.min_points, leaf_m,
                                range.begin, begin + i);
        if (!formulation.needs_points) decoded[i].points = {};
      }
    });
    for (std::size_t i = 0; i < decoded.size(); ++i) {
      Take(std::move(decoded[i]), poses[begin + i - range.begin], formulation, leaf_m, progress,
           &batch);
      progress->Step();
    }
  }
  if (stop) throw InterruptedError("while reading; nothing is written");
  return batch;
}

Trajectory WithStamps(const Batch& batch, const std::vector<SE3>& poses) {
  Trajectory trajectory;
  for (std::size_t k = 0; k < poses.size(); ++k) {
    trajectory.push_back({batch.frames[k].stamp_ns, poses[k]});
  }
  return trajectory;
}

// Every scan of the range gets a line; those that were skipped keep their initial pose.
Trajectory AllScans(const Batch& batch, const ScanSource& source, const FrameRange& range,
                    const std::vector<SE3>& initial, const std::vector<SE3>& poses) {
  Trajectory all;
  for (std::size_t i = range.begin; i < range.end; ++i) {
    all.push_back({source.Stamp(i), initial[i - range.begin]});
  }
  for (std::size_t k = 0; k < poses.size(); ++k) {
    all[batch.scans[k] - range.begin].T_world_lidar = poses[k];
  }
  return all;
}

void PrintSummary(const std::string& out, const RegistrationResult& result,
                  const nlohmann::json& json) {
  if (!result.rounds.empty()) {
    const RoundReport& last = result.rounds.back();
    fmt::print("{} frames, {} planes, {} rounds: {}; cost of the last round {:.6g} -> {:.6g}\n",
               result.poses.size(), last.planes, result.rounds.size(), ToString(result.status),
               last.initial_cost, last.final_cost);
    fmt::print("reading {:.2f} s, building maps {:.2f} s, solving {:.2f} s\n",
               json["read_s"].get<double>(), json["build_s"].get<double>(),
               json["solve_s"].get<double>());
  }
  if (json.contains("ape_rmse_m")) {
    fmt::print("against the truth: APE {:.4f} m, RPE {:.4f} m (RMSE, SE(3)-aligned)\n",
               json["ape_rmse_m"].get<double>(), json["rpe_rmse_m"].get<double>());
  }
  fmt::print(
      "trajectory  {0}/trajectory_tum.txt, {0}/trajectory_kitti.txt\n"
      "map         {0}/map_surfels.ply\n"
      "figures     {0}/summary.json, {0}/rounds.csv{1}\n",
      out, result.covariances.empty() ? "" : fmt::format(", {}/covariance.csv", out));
}

// Frames of a fault are those of the batch: brought to the recording's own count.
void NameScans(const Batch& batch, RegistrationResult* result) {
  for (BundleFault& fault : result->faults) {
    fault.frame = static_cast<int>(batch.scans[static_cast<std::size_t>(fault.frame)]);
    for (int& frame : fault.group) {
      frame = static_cast<int>(batch.scans[static_cast<std::size_t>(frame)]);
    }
  }
}

// Returns the number of surfels.
std::size_t WriteMap(const std::string& path, const BatchRegistration& registration,
                     const Batch& batch, const std::vector<SE3>& poses, int min_frames) {
  SurfelWriter surfels(path);
  registration.VisitSurfels(batch.frames, poses, min_frames,
                            [&](const Surfel& surfel) { surfels.Append(surfel); });
  surfels.Commit();
  return surfels.size();
}

void WarnOfFaults(const RegistrationResult& result, RunProgress* progress) {
  for (const BundleFault& fault : result.faults) progress->Warn(fault.Describe());
  if (result.status == RegistrationResult::Status::kNoBetter) {
    progress->Warn(result.reason + "; the initial poses are written as they were");
  }
  if (!result.covariance_failure.empty()) {
    progress->Warn("no covariances, all else is written: " + result.covariance_failure);
  }
}

// What cannot be used is an error, though all is written.
void ThrowUnlessUsable(const RegistrationResult& result) {
  if (result.status == RegistrationResult::Status::kIllPosed) {
    throw InputError("the registration is ill-posed: " + result.reason +
                     "; the initial poses are written as they were");
  }
  if (result.status == RegistrationResult::Status::kFailed) throw InputError(result.reason);
}

// To the table, and the user if they are told.
RegistrationCallbacks FollowRounds(bool told, RoundTable* rounds) {
  RegistrationCallbacks callbacks;
  callbacks.on_step = [rounds](const RoundReport& round, const BundleStep& step) {
    rounds->Append(round, step);
  };
  callbacks.on_round = [told](const RoundReport& r) {
    if (!told) return;
    fmt::print(stderr, "round {}: voxels {:.2f} m, {} planes, cost {:.6g} -> {:.6g}, {} steps\n",
               r.round, r.root_size_m, r.planes, r.initial_cost, r.final_cost, r.iterations);
  };
  return callbacks;
}

int Register(const RegisterArguments& arguments) {
  const auto limit = LimitThreads(arguments.threads);
  const LaminaConfig config = LoadConfig(arguments.config.file, arguments.config.set);
  const Formulation& formulation = FindFormulation(arguments.formulation);
  const auto source = OpenScans(arguments.scans, config.scans);
  const FrameRange range = ParseFrameRange(arguments.frames, source->size());
  auto given = ReadInitialPoses(arguments.initial, *source, range);
  const Eigen::Vector3d origin = MoveToMapOrigin(&given);
  const std::vector<SE3> initial = Filled(given);
  const RecordingPart part = PartOf(*source, range);
  Trajectory truth;
  if (!arguments.truth.empty()) truth = ReadTruthOfPart(arguments.truth, *source, part);
  CheckOutputFolder(arguments.out, arguments.scans);
  MakeDirectory(arguments.out);
  const auto path = [&](const char* name) {
    return (std::filesystem::path(arguments.out) / name).string();
  };
  RoundTable rounds(path("rounds.csv"));
  const std::atomic<bool>& stop = StopOnSignals();
  RunProgress progress(ProgressMode(arguments.progress), range.end - range.begin);
  Stopwatch watch;
  const double cpu_start = ProcessCpuSeconds();
  RegistrationFigures figures;
  const Batch batch = ReadBatch(*source, range, config, formulation, given, stop, &progress);
  progress.Finish();
  figures.skipped = batch.skipped;
  figures.read_s = 1e-3 * watch.LapMilliseconds();

  const BatchRegistration registration(config.registration, config.map, config.backend.window,
                                       formulation);
  RegistrationCallbacks callbacks = FollowRounds(arguments.progress != "off", &rounds);
  Trajectory poses;
  callbacks.on_poses = [&](const RegistrationResult& solved) {
    poses = MovedBy(origin, WithStamps(batch, solved.poses));
    RemoveStaleResults(arguments.out, {"trajectory_kitti.txt", "trajectory_tum.txt", "rounds.csv",
                                       "covariance.csv", "map_surfels.ply"});
    WriteTextFile(path("config.yaml"), ToYaml(config));
    WriteKittiTrajectory(path("trajectory_kitti.txt"),
                         MovedBy(origin, AllScans(batch, *source, range, initial, solved.poses)));
    WriteTumTrajectory(path("trajectory_tum.txt"), poses);
  };
  RegistrationResult result = registration.Run(batch.frames, callbacks, &stop);
  NameScans(batch, &result);
  WarnOfFaults(result, &progress);
  rounds.Commit();
  if (!result.covariances.empty())
    WriteCovariances(path("covariance.csv"), batch.scans, result.covariances);
  figures.map_surfels = WriteMap(path("map_surfels.ply"), registration, batch, result.poses,
                                 config.backend.min_surfel_frames);
  figures.wall_s = 1e-3 * watch.Milliseconds();
  figures.cpu_s = ProcessCpuSeconds() - cpu_start;
  std::optional<TrajectoryErrors> errors;
  if (!arguments.truth.empty()) {
    errors = ErrorsOf(MatchToTruth({"the registration", poses}, truth, kStampToleranceS),
                      Alignment::kSe3);
  }
  nlohmann::json summary =
      Summarise(result, batch.scans, formulation.name, figures, errors ? &*errors : nullptr);
  summary["recording"] = ToJson(part);
  // Of map_surfels.ply, in the frame of the poses.
  summary["map_origin_m"] = {origin.x(), origin.y(), origin.z()};
  WriteTextFile(path("summary.json"), summary.dump(2) + "\n");
  ThrowUnlessUsable(result);
  PrintSummary(arguments.out, result, summary);
  if (stop) throw InterruptedError("the results are those of the rounds until then");
  // Poses that were given and not bettered may be good; frames of which nothing is known are not.
  const bool no_better = result.status == RegistrationResult::Status::kNoBetter;
  return no_better && !result.faults.empty() ? kProbablyWrong : 0;
}

}  // namespace

void AddRegisterCommand(CLI::App* app, std::function<int()>* run) {
  auto arguments = std::make_shared<RegisterArguments>();
  RegisterArguments& a = *arguments;
  CLI::App* command = app->add_subcommand(
      "register", "Bring all scans of a batch together at once, from initial poses");
  command->add_option("--scans", a.scans, "Recording, as for `lamina run`")->required();
  command
      ->add_option("--initial", a.initial,
                   "Initial poses, KITTI or TUM form: one for each scan in order, or by their "
                   "stamps")
      ->required();
  command->add_option("--out", a.out, "Folder for the results; made if it is not there")
      ->required();
  command
      ->add_option(
          "--formulation", a.formulation,
          "How bundle adjustment is formulated; others than the default are there to compare")
      ->capture_default_str()
      ->check(CLI::IsMember(FormulationNames()));
  AddTopicOption(command, &a.config);
  AddConfigOptions(command, "; registration, map and backend.window are what counts here",
                   &a.config);
  AddFramesOption(command, &a.frames);
  AddThreadsOption(command, "", &a.threads);
  command->add_option("--truth", a.truth, "True trajectory to report errors against");
  AddProgressOption(command, &a.progress);
  command->callback([arguments, run] { *run = [arguments] { return Register(*arguments); }; });
}

}  // namespace lamina
