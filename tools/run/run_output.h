// Everything that a run leaves in its folder.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "backend/calibration/opening_calibration.h"
#include "backend/mapping/mapping.h"
#include "config/config.h"
#include "tools/cli/common.h"
#include "tools/results/piece_trajectories.h"
#include "tools/results/recording_part.h"
#include "tools/run/joined_run.h"

namespace lamina {

// What summary.json and the verdict rest on, gathered while the scans come. Nothing of an earlier
// run is touched before Finish.
class RunOutput {
 public:
  RunOutput(const std::string& directory, int max_iterations);

  void Add(const ScanRecord& scan) { open_.push_back(scan); }
  // Of the first scan that has none yet.
  void Add(const FinalPose& pose);
  RunVerdict Judge() const { return table_.Judge(); }
  // The pose of each scan as known when it came.
  void AddLive(const MappedScan& report);
  // Moves all poses with their submaps; what they were goes to files of its own.
  void Correct(const JoinedRun& run);
  // By the piece in whose frame they are, without the scans that were skipped.
  std::map<std::int64_t, Trajectory> Pieces() const;

  // Writes all files; the summary. Throws OutputError.
  nlohmann::json Finish(const MappingCounts& counts, const VoxelMap& map,
                        const LaminaConfig& config, const RecordingPart& part, RunFigures figures,
                        const PieceErrors& errors, const OpeningCalibration& beams,
                        const JoinedRun* loops);

  std::string Path(const std::string& name) const;

 private:
  void WriteTrajectories(const std::vector<FinalPose>& poses, const std::string& name) const;
  void WritePoses(const JoinedRun* loops);

  std::string directory_;
  FrameTable table_;
  std::deque<ScanRecord> open_;  // scans without a final pose
  std::vector<FinalPose> poses_, odometry_, live_poses_;
  SE3 live_;  // of the last scan
};

}  // namespace lamina
