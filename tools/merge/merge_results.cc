#include "tools/merge/merge_results.h"

#include <fmt/format.h>

#include <filesystem>
#include <map>

#include "backend/loops/piece_loops.h"
#include "io/file/file_writer.h"
#include "io/map/trajectory_io.h"
#include "io/store/tile_store.h"
#include "tools/cli/common.h"
#include "tools/results/graph_file.h"
#include "tools/results/loop_evidence.h"
#include "tools/results/output_folder.h"
#include "tools/results/piece_trajectories.h"
#include "tools/results/verdict/process_report.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

std::string LoopRow(const MergedMap& merged, const Loop& loop) {
  const MergedMap::Origin &from = merged.origin(loop.from), &to = merged.origin(loop.to);
  return fmt::format("{},{},{},{},{},{},{},{},{:.6f},{}\n", from.drive, from.piece, from.submap->id,
                     to.drive, to.piece, to.submap->id, ToString(loop.status), loop.reason,
                     loop.score, LoopEvidence(loop.match));
}

class MergeOutput {
 public:
  MergeOutput(const std::string& folder, const std::vector<Drive>& drives, const MergedMap& merged)
      : folder_(folder), drives_(drives), merged_(merged) {}

  // Of all drives together, and of each; frames.csv tells which pose is of which.
  nlohmann::json WriteTrajectories() const {
    nlohmann::json json = nlohmann::json::array();
    std::map<std::size_t, Trajectory> by_frame;
    Trajectory all;
    RemovePieceFiles(folder_, DriveTrajectoryName);
    FileWriter table(Path("frames.csv"));
    table.Write("scan,stamp_s,status,piece,frame,drive\n");
    for (std::size_t d = 0; d < drives_.size(); ++d) {
      Trajectory drive;
      const std::vector<MergedMap::Posed> posed = merged_.PosesOf(d);
      std::map<std::size_t, std::size_t> frames;
      for (const MergedMap::Posed& p : posed) {
        const StampedPose pose{p.pose->pose.stamp_ns, p.T_frame_lidar};
        std::string line = fmt::format("{},", all.size());
        AppendSeconds(pose.stamp_ns, &line);
        table.Write(line + fmt::format(",{},{},{},{}\n", p.pose->status, p.piece, p.frame, d));
        all.push_back(pose);
        drive.push_back(pose);
        by_frame[p.frame].push_back(pose);
        ++frames[p.frame];
      }
      WriteTumTrajectory(Path(DriveTrajectoryName(static_cast<std::int64_t>(d))), drive);
      nlohmann::json of_drive = {{"folder", drives_[d].folder},
                                 {"poses", posed.size()},
                                 {"poses_without_map", drives_[d].poses.size() - posed.size()},
                                 {"frames", nlohmann::json::array()}};
      for (const auto& [frame, poses] : frames)
        of_drive["frames"].push_back({{"frame", frame}, {"poses", poses}});
      json.push_back(of_drive);
    }
    WriteTumTrajectory(Path("trajectory_tum.txt"), all);
    RemovePieceFiles(folder_, PieceTrajectoryName);
    for (const auto& [frame, poses] : by_frame) {
      if (by_frame.size() > 1)
        WriteTumTrajectory(Path(PieceTrajectoryName(static_cast<std::int64_t>(frame))), poses);
    }
    table.Commit();
    return json;
  }

  std::size_t WriteSurfaces(const LaminaConfig& config) const {
    TileStore tiles(Path("map_tiles.scratch"), TileStore::Lifetime::kScratch);
    VoxelMap map(config.map, &tiles);
    merged_.AddTo(&map);
    return WriteMap(folder_, map, config.backend.min_surfel_frames);
  }

  void WriteLoops() const {
    FileWriter table(Path("loops.csv"));
    table.Write(fmt::format("drive,piece,from,to_drive,to_piece,to,status,reason,score,{}\n",
                            kLoopEvidenceColumns));
    for (const Loop& loop : merged_.loops()) table.Write(LoopRow(merged_, loop));
    table.Commit();
  }

  void WriteGraphs() const {
    RemovePieceFiles(folder_, GraphFileName);
    std::vector<SubmapFrameView> views;
    for (std::size_t frame = 0; frame < merged_.frames(); ++frame) {
      SubmapFrameView view;
      view.frame = static_cast<std::int64_t>(frame);
      for (const std::size_t i : merged_.SubmapsOfFrame(frame)) {
        const MergedMap::Origin& origin = merged_.origin(i);
        view.pieces.push_back(merged_.PieceNumber(origin.drive, origin.piece));
        view.submaps.push_back(origin.submap);
      }
      view.graph = PartOfGraph(merged_.graph(), merged_.SubmapsOfFrame(frame));
      view.trimmed = merged_.TrimmedOfFrame(frame);
      if (!view.submaps.empty()) WriteAnchorGraph(Path(GraphFileName(view.frame)), view.graph);
      views.push_back(std::move(view));
    }
    WriteSubmaps(Path(kSubmapFileName), views);
  }

 private:
  std::string Path(const std::string& name) const { return (fs::path(folder_) / name).string(); }

  const std::string& folder_;
  const std::vector<Drive>& drives_;
  const MergedMap& merged_;
};

nlohmann::json FramesToJson(const MergedMap& merged) {
  nlohmann::json frames = nlohmann::json::array();
  for (std::size_t frame = 0; frame < merged.frames(); ++frame) {
    std::map<std::size_t, std::size_t> submaps;
    for (const std::size_t i : merged.SubmapsOfFrame(frame)) ++submaps[merged.origin(i).drive];
    nlohmann::json drives = nlohmann::json::array();
    for (const auto& [drive, count] : submaps) drives.push_back(drive);
    frames.push_back(
        {{"frame", frame}, {"submaps", merged.SubmapsOfFrame(frame).size()}, {"drives", drives}});
  }
  return frames;
}

}  // namespace

std::string DriveTrajectoryName(std::int64_t drive) {
  return fmt::format("trajectory_tum_drive{}.txt", drive);
}

nlohmann::json WriteMerge(const std::string& folder, const std::vector<Drive>& drives,
                          const MergedMap& merged, const LaminaConfig& config) {
  std::vector<std::string> written = {"trajectory_tum.txt", "frames.csv", "map_surfels.ply",
                                      "loops.csv",          "graph.g2o",  kSubmapFileName};
  RemoveStaleResults(folder, written);
  const MergeOutput output(folder, drives, merged);
  nlohmann::json summary;
  summary["drives"] = output.WriteTrajectories();
  output.WriteLoops();
  output.WriteGraphs();
  WriteTextFile((fs::path(folder) / "config.yaml").string(), ToYaml(config));
  summary["map_surfels"] = output.WriteSurfaces(config);
  summary["frames"] = FramesToJson(merged);
  std::map<std::string, std::size_t> refused;
  std::size_t accepted = 0;
  for (const Loop& loop : merged.loops()) {
    if (loop.status == Loop::Status::kAccepted) {
      ++accepted;
    } else {
      ++refused[loop.reason];
    }
  }
  const SubmapBundleResult& bundle = merged.bundle();
  summary["loops"] = {{"accepted", accepted}, {"refused_by_reason", refused}};
  summary["bundle"] = {{"rounds", bundle.rounds},
                       {"planes", bundle.planes},
                       {"observations", bundle.observations},
                       {"largest_move_m", bundle.largest_move_m},
                       {"refusal", bundle.refusal}};
  return summary;
}

}  // namespace lamina
