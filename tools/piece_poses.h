// Which piece of the map the poses of a run or a session are of (backend/serial_mapping.h). Poses
// of different pieces are in different frames, and must not be put together.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "core/scan.h"

namespace lamina {

std::vector<std::string_view> SplitAtCommas(std::string_view line);

// The piece of each of the so many poses of trajectory_tum.txt, or of trajectory_kitti.txt, out of
// frames.csv beside it; empty if that is missing or does not tell. Throws InputError.
std::vector<std::int64_t> ReadPieces(const std::string& folder, std::size_t poses);

// The poses of a file by piece, if it is one of those two; else all are of piece 0. Throws
// InputError.
std::map<std::int64_t, Trajectory> SplitIntoPieces(const std::string& path,
                                                   const Trajectory& poses);

// The poses of trajectory_tum.txt that are of the first piece. Throws InputError.
Trajectory ReadFirstPiece(const std::string& folder);

}  // namespace lamina
