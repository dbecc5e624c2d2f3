#include "backend/session/trajectory_files.h"

#include <algorithm>
#include <filesystem>
#include <utility>

#include "backend/session/scan_record.h"

namespace lamina {
namespace {

std::string In(const std::string& folder, const char* name) {
  return (std::filesystem::path(folder) / name).string();
}

}  // namespace

TrajectoryFiles::TrajectoryFiles(const std::string& folder, PieceCorrections corrections)
    : corrections_(std::move(corrections)),
      files_{{{TrajectoryForm::kKitti, PublishedFile(In(folder, "trajectory_kitti.txt"))},
              {TrajectoryForm::kTum, PublishedFile(In(folder, "trajectory_tum.txt"))}}} {}

void TrajectoryFiles::AppendLine(FinalPose pose, TrajectoryForm form, std::string* lines) const {
  if (form == TrajectoryForm::kTum && pose.skipped) return;
  pose.pose.T_world_lidar =
      corrections_.Corrected(pose.piece, pose.pose.stamp_ns, pose.pose.T_world_lidar);
  AppendPoseLine(pose.pose, form, lines);
}

void TrajectoryFiles::Publish(const SessionDatabase& database, std::int64_t scans,
                              const std::vector<FinalPose>& open) {
  const std::int64_t final = open.empty() ? scans : static_cast<std::int64_t>(open.front().scan);
  std::vector<FinalPose> recorded;
  for (const FinalPose& pose : open) recorded.push_back(AsRecorded(database, pose));
  for (File& file : files_) Publish(database, final, recorded, &file);
}

void TrajectoryFiles::Publish(const SessionDatabase& database, std::int64_t final,
                              const std::vector<FinalPose>& open, File* file) const {
  // Many rows are read in portions: under a reader the database's log cannot begin anew.
  constexpr std::int64_t kRowsAtOnce = 1000;
  std::string lines;
  while (file->final < final) {
    const std::int64_t to = std::min(file->final + kRowsAtOnce, final);
    lines.clear();
    database.ForEach(file->final, to,
                     [&](const ScanRecord& scan) { AppendLine(PoseOf(scan), file->form, &lines); });
    file->file.Append(lines);
    file->final = to;
  }
  lines.clear();
  for (const FinalPose& pose : open) AppendLine(pose, file->form, &lines);
  file->file.Publish(lines);
}

}  // namespace lamina
