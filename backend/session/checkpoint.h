// Checkpoints in the folder of a session: their names, and how they are read
// (backend/session/session.h has the format).
//
// Private to backend/session.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "backend/mapping/mapping.h"

namespace lamina {

// `scans`: how many scans are in it.
std::string CheckpointName(std::int64_t scans);

// The checkpoints in a folder, by their number of scans, the newest first.
std::vector<std::int64_t> CheckpointsIn(const std::string& folder);

enum class CheckpointPart { kAll, kMap };

// Into a new mapping. `fixed_options` must be those that the session of the checkpoint was begun
// with. Returns how many records of the map the tiles had. Throws InputError, naming the file, if
// it is damaged or was made with others; the mapping is of no use then.
std::uint64_t ReadCheckpoint(const std::string& path, const std::string& fixed_options,
                             CheckpointPart part, Mapping* mapping);

}  // namespace lamina
