#include "backend/session/room.h"

#include <filesystem>
#include <vector>

#include "backend/session/checkpoint.h"

namespace lamina {

std::uint64_t RoomToContinue(const std::string& folder) {
  const std::vector<std::int64_t> checkpoints = CheckpointsIn(folder);
  if (checkpoints.empty()) return kWorkingRoomBytes;
  std::error_code error;
  const auto newest =
      std::filesystem::file_size(folder + "/" + CheckpointName(checkpoints.front()), error);
  return kWorkingRoomBytes + (error ? 0 : newest);
}

}  // namespace lamina
