#include "tools/export/command.h"

#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "config/config.h"
#include "core/base/error.h"
#include "io/map/map_io.h"
#include "io/recording/scan_source.h"
#include "tools/cli/options.h"
#include "tools/export/cloud.h"
#include "tools/export/trajectory.h"
#include "tools/results/output_folder.h"
#include "tools/results/piece_poses.h"
#include "tools/results/recording_part.h"
#include "tools/results/run_summary.h"

namespace lamina {
namespace {

// Run directories hold the stamps that they were given, to the nanosecond.
constexpr double kStampToleranceS = 1e-6;

struct ExportArguments {
  std::string run;
  std::string scans;
  std::optional<std::string> topic;  // of the scans; nothing: that of the run
  std::string format = "ply";
  std::string out;
  std::string trajectory;
  double resolution_m = 0.1;
  std::int64_t piece = 0;
  std::optional<std::int64_t> drive;
  ExportOptions options;
};

// Poses of a piece, and what frames.csv tells of each, or nothing of any.
struct PosesOfRun {
  Trajectory poses;
  std::vector<FrameRow> rows;
  std::size_t lost = 0;  // left out: where a scan was that matched nothing is not known

  // Those for which `keep` holds.
  template <typename Predicate>
  void KeepIf(const Predicate& keep) {
    Trajectory poses_kept;
    std::vector<FrameRow> rows_kept;
    for (std::size_t i = 0; i < rows.size(); ++i) {
      if (!keep(rows[i])) continue;
      poses_kept.push_back(poses[i]);
      rows_kept.push_back(rows[i]);
    }
    poses = std::move(poses_kept);
    rows = std::move(rows_kept);
  }
};

// The drive of a merged map that is this recording. Stamps alone may not tell, as where recordings
// begin at zero.
std::int64_t DriveOf(const ScanSource& scans, const PosesOfRun& run,
                     const ExportArguments& arguments) {
  std::map<std::int64_t, Trajectory> drives;
  for (std::size_t i = 0; i < run.rows.size(); ++i)
    drives[run.rows[i].drive].push_back(run.poses[i]);
  if (arguments.drive) {
    if (drives.count(*arguments.drive) > 0) return *arguments.drive;
    throw OptionError(fmt::format("--drive {}: {} has no poses of such a drive in piece {}",
                                  *arguments.drive, arguments.run, arguments.piece));
  }
  if (drives.size() == 1) return drives.begin()->first;
  std::vector<std::int64_t> fitting;
  for (const auto& [drive, poses] : drives) {
    if (2 * PoseScans(scans, poses, kStampToleranceS).size() >= poses.size())
      fitting.push_back(drive);
  }
  if (fitting.size() > 1) {
    throw OptionError(fmt::format(
        "--drive is needed: by their stamps the scans of {} may be those of drives {} of {}, in "
        "the order in which summary.json lists them",
        arguments.scans, fmt::join(fitting, ", "), arguments.run));
  }
  return fitting.empty() ? drives.begin()->first : fitting.front();
}

// In the frame of the map.
PosesOfRun ReadPosesOf(const ScanSource& scans, const ExportArguments& arguments) {
  PosesOfRun run;
  const Eigen::Vector3d origin = ReadMapOrigin(arguments.run);
  run.poses = MovedBy(-origin, ReadPiece(arguments.run, arguments.piece, &run.rows));
  if (!origin.isZero())
    fmt::print("coordinates are those of the map, whose origin is at {} {} {} (summary.json)\n",
               origin.x(), origin.y(), origin.z());
  if (run.rows.empty()) {
    if (!arguments.drive) return run;
    throw OptionError(fmt::format("--drive {}: {} has no frames.csv that tells of drives",
                                  *arguments.drive, arguments.run));
  }
  const std::int64_t drive = DriveOf(scans, run, arguments);
  run.KeepIf([&](const FrameRow& row) { return row.drive == drive; });
  const std::size_t all = run.poses.size();
  run.KeepIf([](const FrameRow& row) { return row.status != "lost"; });
  run.lost = all - run.poses.size();
  return run;
}

// Whether the scans are those that the run has posed: as many in all, and where the run tells, the
// same points in the first, the middle and the last.
void RequireSameRecording(const ScanSource& scans, const std::vector<PosedScan>& posed,
                          const ExportArguments& arguments, const PosesOfRun& run,
                          const ScanPreparationOptions& preparation) {
  const auto& [trajectory, rows, lost] = run;
  const auto refuse = [&](const std::string& why) {
    throw InputError(fmt::format("{} and {} do not belong together: {}; is it another recording?",
                                 arguments.run, arguments.scans, why));
  };
  const auto part = ReadRecordingPart(arguments.run);
  if (part && part->scans != scans.size()) {
    refuse(fmt::format("the run is of a recording of {} scans, this one has {}", part->scans,
                       scans.size()));
  }
  const std::size_t wanted = part ? trajectory.size() : std::max(trajectory.size(), scans.size());
  if (2 * posed.size() < (rows.empty() ? wanted : trajectory.size())) {
    refuse(fmt::format("{} of {} poses have the stamp of one of the {} scans", posed.size(),
                       trajectory.size(), scans.size()));
  }
  std::map<StampNs, std::size_t> points;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (rows[i].points) points[trajectory[i].stamp_ns] = *rows[i].points;
  }
  for (const std::size_t i : {std::size_t{0}, posed.size() / 2, posed.size() - 1}) {
    const Scan scan = scans.Read(posed[i].scan);
    const auto known = points.find(scans.Stamp(posed[i].scan));
    if (known == points.end()) continue;
    const std::size_t usable =
        PrepareScan(scan, preparation, 0.1, scans.T_vehicle_lidar(posed[i].scan)).points.size();
    if (usable == known->second) continue;
    refuse(fmt::format("{} has {} usable points, the run found {} in the scan of this stamp",
                       scans.Name(posed[i].scan), usable, known->second));
  }
}

// What is written among the scans would be one of them from then on.
void CheckOutput(const std::string& out, const std::string& scans) {
  CheckReplacesNoResult("--out", out);
  const std::string folder = std::filesystem::absolute(out).parent_path().string();
  if (!IsWithin(folder, scans)) return;
  throw OptionError(fmt::format("--out {}: is in the folder of the recording, {}", out, scans));
}

int ExportCloudOf(const ExportArguments& arguments) {
  const std::filesystem::path run = arguments.run;
  LaminaConfig config = LoadConfig((run / "config.yaml").string(), {});
  config.scans.topic = arguments.topic.value_or(config.scans.topic);
  const std::unique_ptr<ScanSource> scans = OpenScans(arguments.scans, config.scans);
  const PosesOfRun poses = ReadPosesOf(*scans, arguments);
  ExportOptions options = arguments.options;
  options.resolution_m = arguments.resolution_m;
  options.preparation = config.preparation;
  options.frame_period_s = config.scans.frame_period_s;

  const std::vector<PosedScan> posed = PoseScans(*scans, poses.poses, kStampToleranceS);
  if (posed.empty()) {
    throw InputError(fmt::format(
        "{}: none of its {} poses has the stamp of one of the {} scans of {}; is it another "
        "recording?",
        (run / "trajectory_tum.txt").string(), poses.poses.size(), scans->size(), arguments.scans));
  }
  RequireSameRecording(*scans, posed, arguments, poses, config.preparation);
  const std::string ending = arguments.format == "copc" ? "copc.laz" : arguments.format;
  const std::string out =
      arguments.out.empty() ? (run / ("cloud." + ending)).string() : arguments.out;
  CheckOutput(out, arguments.scans);
  CloudWriter writer(out);
  const ExportResult result = ExportCloud(*scans, posed, options, &writer, &StopOnSignals());
  if (result.interrupted) throw InterruptedError("nothing is written");
  if (result.points == 0) {
    throw InputError(fmt::format(
        "no point is left: {} are too far from the origin for voxels of {} m, all others out of "
        "range; nothing is written",
        result.points_beyond_grid, options.resolution_m));
  }
  writer.Commit();
  fmt::print("{}: {} points, one per {} m voxel, of {} scans ({} of {} poses, {} of the recording)",
             out, result.points, options.resolution_m, posed.size(), posed.size(),
             poses.poses.size(), scans->size());
  fmt::print(", in {} {}\n", result.passes, result.passes == 1 ? "pass" : "passes");
  if (poses.lost > 0) {
    fmt::print("left out {} scans that were lost: where they were taken is not known\n",
               poses.lost);
  }
  if (result.points_beyond_grid > 0) {
    fmt::print("left out {} points too far from the origin for voxels of {} m\n",
               result.points_beyond_grid, options.resolution_m);
  }
  return 0;
}

int RunExport(const ExportArguments& arguments) {
  const bool cloud = !arguments.scans.empty();
  if (!cloud && arguments.trajectory.empty()) {
    throw OptionError("export: --scans, the recording, is needed for a cloud, or --trajectory");
  }
  if (!arguments.trajectory.empty()) {
    CheckReplacesNoResult("--trajectory", arguments.trajectory);
    const std::size_t poses = ExportTrajectory(arguments.run, arguments.trajectory);
    fmt::print("{}: {} poses\n", arguments.trajectory, poses);
  }
  return cloud ? ExportCloudOf(arguments) : 0;
}

}  // namespace

void AddExportCommand(CLI::App* app, std::function<int()>* run) {
  CLI::App* command = app->add_subcommand(
      "export",
      "Write the full point map of a finished run, thinned to one point per voxel, or its "
      "trajectory for other programs");
  auto arguments = std::make_shared<ExportArguments>();
  command
      ->add_option("--run", arguments->run,
                   "Directory written by `lamina run`; read are trajectory_tum.txt (the poses) and "
                   "config.yaml (ranges, deskewing)")
      ->type_name("DIR")
      ->required();
  CLI::Option* const scans =
      command
          ->add_option("--scans", arguments->scans,
                       "The recording that the run was made from. Scans are found by stamp; those "
                       "without a pose are left out")
          ->type_name("PATH");
  AddTopicOption(command, &arguments->topic);
  command
      ->add_option("--resolution", arguments->resolution_m,
                   "Edge of the voxels of which each keeps its first point")
      ->type_name("METRES")
      ->capture_default_str()
      ->needs(scans);
  command
      ->add_option("--piece", arguments->piece,
                   "The piece of the map of which poses are taken, with those joined to it")
      ->type_name("N")
      ->capture_default_str()
      ->check(CLI::NonNegativeNumber)
      ->needs(scans);
  command
      ->add_option("--drive", arguments->drive,
                   "Of a merged map, the drive that the recording is. Default: the one whose "
                   "stamps it has")
      ->type_name("N")
      ->check(CLI::NonNegativeNumber)
      ->needs(scans);
  command->add_option("--format", arguments->format, "Format of the default output file")
      ->check(CLI::IsMember({"ply", "pcd", "las", "laz", "copc"}))
      ->capture_default_str();
  command
      ->add_option(
          "--out", arguments->out,
          "Output file, .ply, .pcd, .las, .laz or .copc.laz (COPC, which viewers show while "
          "they load it). Default: cloud.ply, or with another ending, in the run "
          "directory. LAS 1.4, LAZ and COPC keep 0.1 mm anywhere, and the stamps of points")
      ->type_name("FILE");
  command
      ->add_option(
          "--trajectory", arguments->trajectory,
          "Write the poses to this file as well, or alone: .csv, with the diagonal of each "
          "one's covariance by its match (rad^2, m^2), or .geojson in the map's own frame")
      ->type_name("FILE");
  command
      ->add_option("--budget-mb", arguments->options.budget_mb,
                   "Memory for the set of voxels taken. A larger map is made in several "
                   "passes over the scans; its points are the same")
      ->type_name("MIB")
      ->capture_default_str();
  command->callback([arguments, run] { *run = [arguments] { return RunExport(*arguments); }; });
}

}  // namespace lamina
