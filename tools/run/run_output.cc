#include "tools/run/run_output.h"

#include <filesystem>

#include "io/map/trajectory_io.h"
#include "tools/results/output_folder.h"
#include "tools/results/verdict/process_report.h"
#include "tools/run/beam_correction.h"
#include "tools/run/loop_results.h"

namespace lamina {

RunOutput::RunOutput(const std::string& directory, int max_iterations)
    : directory_(directory), table_(Path("frames.csv"), max_iterations) {}

std::string RunOutput::Path(const std::string& name) const {
  return (std::filesystem::path(directory_) / name).string();
}

void RunOutput::Add(const FinalPose& pose) {
  poses_.push_back(pose);
  ScanRecord& scan = open_.front();
  if (pose.given_up) scan.GiveUp();
  // The verdict is on the poses that are written: those of a start may have been overruled since.
  scan.T_world_lidar = pose.pose.T_world_lidar;
  table_.Append(scan);
  open_.pop_front();
}

void RunOutput::AddLive(const MappedScan& report) {
  if (!report.skipped) live_ = report.odometry.T_world_lidar;
  live_poses_.push_back({report.index, {report.stamp_ns, live_}, report.skipped, report.piece});
}

void RunOutput::Correct(const JoinedRun& run) {
  odometry_ = poses_;
  table_.Join(run.joins());
  for (FinalPose& pose : poses_) {
    pose.pose.T_world_lidar =
        run.Corrected(pose.piece, pose.pose.stamp_ns, pose.pose.T_world_lidar);
    pose.piece = run.FrameOf(pose.piece);
  }
}

std::map<std::int64_t, Trajectory> RunOutput::Pieces() const {
  std::map<std::int64_t, Trajectory> pieces;
  for (const FinalPose& pose : poses_) {
    if (!pose.skipped) pieces[pose.piece].push_back(pose.pose);
  }
  return pieces;
}

void RunOutput::WritePoses(const JoinedRun* loops) {
  WriteTrajectories(poses_, "trajectory");
  if (loops != nullptr) {
    WriteTrajectories(odometry_, "trajectory_odometry");
    WriteTrajectories(live_poses_, "trajectory_live");
    WriteLoopFiles(directory_, *loops);
    WriteSubmaps(Path(kSubmapFileName), loops->Frames());
  }
  WritePieceTrajectories(directory_, table_.FramesOfPieces(), [&](const FinalPoses::Visit& visit) {
    for (const FinalPose& pose : poses_) visit(pose);
  });
  table_.Commit();
  if (loops != nullptr && !loops->joins().empty())
    AddFrameColumn(Path("frames.csv"), loops->joins());
}

nlohmann::json RunOutput::Finish(const MappingCounts& counts, const VoxelMap& map,
                                 const LaminaConfig& config, const RecordingPart& part,
                                 RunFigures figures, const PieceErrors& errors,
                                 const OpeningCalibration& beams, const JoinedRun* loops) {
  // Not before now: until here the results of an earlier run are whole.
  std::vector<std::string> written = {"trajectory_kitti.txt", "trajectory_tum.txt", "frames.csv",
                                      "map_surfels.ply"};
  if (loops != nullptr) {
    written.insert(written.end(), {"trajectory_odometry_tum.txt", "trajectory_odometry_kitti.txt",
                                   "trajectory_live_tum.txt", "trajectory_live_kitti.txt",
                                   "loops.csv", "graph.g2o", kSubmapFileName});
  }
  RemoveStaleResults(directory_, written);
  // First what cannot be made again: poses, then the map.
  WritePoses(loops);
  WriteTextFile(Path("config.yaml"), ToYaml(config));
  figures.map_surfels =
      WriteMap(directory_, map, LeastSurfelFrames(config.backend.min_surfel_frames, counts));
  nlohmann::json summary = Summarise(counts, map, figures);
  summary["pieces"] = table_.PiecesToJson();
  if (!errors.empty()) AddErrors(errors, &summary);
  if (loops != nullptr) summary["loops"] = LoopSummary(*loops);
  summary["recording"] = ToJson(part);
  if (beams.scans > 0) summary["beam_correction"] = ToJson(beams);
  summary["verdict"] = ToJson(table_.Judge());
  WriteTextFile(Path("summary.json"), SummaryText(summary));
  return summary;
}

void RunOutput::WriteTrajectories(const std::vector<FinalPose>& poses,
                                  const std::string& name) const {
  Trajectory all_scans, frames;
  for (const FinalPose& pose : poses) {
    all_scans.push_back(pose.pose);
    if (!pose.skipped) frames.push_back(pose.pose);
  }
  WriteKittiTrajectory(Path(name + "_kitti.txt"), all_scans);
  WriteTumTrajectory(Path(name + "_tum.txt"), frames);
}

}  // namespace lamina
