// The trajectory files of a session, kept current for days:
//
//     trajectory_kitti.txt    a line a scan                        (io/map/trajectory_io.h)
//     trajectory_tum.txt      a line a scan that was not skipped
//
// Lines of final poses are written once; only those of the open ones are replaced. What a
// publication costs does not depend on how long the session is; the first one, which trusts no file
// that is there, writes all lines from the database. Where loops correct poses, all change at once:
// then it is a new TrajectoryFiles that writes them.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "backend/loops/piece_loops.h"
#include "backend/mapping/final_poses.h"
#include "io/file/published_file.h"
#include "io/map/trajectory_io.h"
#include "io/store/session_database.h"

namespace lamina {

// Not thread-safe. Throws OutputError; then the next publication makes up for it.
class TrajectoryFiles {
 public:
  // Poses in the database are those of odometry; the files have them corrected.
  explicit TrajectoryFiles(const std::string& folder, PieceCorrections corrections = {});

  // The trajectory of scans [0, scans): the last ones as in `open`, those before, which must be
  // final, as in the database. What was final stays so.
  void Publish(const SessionDatabase& database, std::int64_t scans,
               const std::vector<FinalPose>& open);

 private:
  struct File {
    TrajectoryForm form;
    PublishedFile file;
    std::int64_t final = 0;  // scans whose lines are in the part that stays
  };
  void Publish(const SessionDatabase& database, std::int64_t final,
               const std::vector<FinalPose>& open, File* file) const;
  void AppendLine(FinalPose pose, TrajectoryForm form, std::string* lines) const;

  PieceCorrections corrections_;
  std::array<File, 2> files_;
};

}  // namespace lamina
