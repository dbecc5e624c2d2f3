// Which piece of the map the poses of a run or a session are of (backend/mapping/mapping.h).
// Poses of different pieces are in different frames, and must not be put together. Pieces that were
// joined at the end of a run share the frame of one of them (`frame` in frames.csv), and count as
// that one here.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "core/geometry/scan.h"

namespace lamina {

std::vector<std::string_view> SplitAtCommas(std::string_view line);

// What frames.csv tells of a scan.
struct FrameRow {
  std::int64_t piece = 0;      // in whose frame the pose is
  std::int64_t own_piece = 0;  // that it was mapped in
  std::int64_t drive = 0;      // of a merged map
  bool has_pose = false;       // it was not skipped
  std::string status;
  // Nothing if there is no such column.
  std::optional<StampNs> stamp_ns;
  std::optional<std::size_t> points;  // usable ones
  // Diagonal of the covariance of the pose by its match, rotation first, as it stands there: six
  // numbers with commas between; empty if there are no such columns.
  std::string covariance;
};

// Those of all scans, as trajectory_kitti.txt has them; empty if frames.csv is missing or knows no
// pieces. Throws InputError.
std::vector<FrameRow> ReadFrameRows(const std::string& folder);

// Those of the poses of trajectory_tum.txt, `poses`, one each; empty, too, while a session is under
// way, whose table is that of its last end. Throws InputError if they are not of the same run: as
// many, with the same stamps.
std::vector<FrameRow> ReadPosedRows(const std::string& folder, const Trajectory& poses);

// The piece of each of the poses of trajectory_tum.txt, out of frames.csv beside it; empty if that
// is missing or does not tell. Throws InputError.
std::vector<std::int64_t> ReadPieces(const std::string& folder, const Trajectory& poses);

// The poses of a file by piece, if it is the trajectory_tum.txt or trajectory_kitti.txt of a run or
// session; else all are of piece 0. Of the latter they may be a part, from `first_line` on. Throws
// InputError, as ReadPosedRows does.
std::map<std::int64_t, Trajectory> SplitIntoPieces(const std::string& path, const Trajectory& poses,
                                                   std::size_t first_line = 0);

// The poses of trajectory_tum.txt that are of a piece. `rows` become those of these poses, or empty.
// Throws InputError, also where there is no such piece.
Trajectory ReadPiece(const std::string& folder, std::int64_t piece,
                     std::vector<FrameRow>* rows = nullptr);

}  // namespace lamina
