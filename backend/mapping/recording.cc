#include "backend/mapping/recording.h"

namespace lamina {

RegisteredScan Mapping::Recording::Process(const MapperScan& scan, bool may_restart) {
  return mapper != nullptr ? mapper->Process(scan, may_restart)
                           : localiser->Process(scan, may_restart);
}

Trajectory Mapping::Recording::TakeFinal(std::int64_t before_scan) {
  if (rests()) return {};
  return mapper != nullptr ? mapper->mapper().TakeFinal(before_scan) : localiser->TakeFinal();
}

Trajectory Mapping::Recording::OpenPoses() const {
  if (rests()) return {};
  return mapper != nullptr ? mapper->mapper().OpenFrames() : localiser->final_poses();
}

Trajectory Mapping::Recording::LastPoses() const {
  constexpr std::size_t kLast = 5;
  Trajectory poses = OpenPoses();
  if (poses.size() > kLast) poses.erase(poses.begin(), poses.end() - kLast);
  return poses;
}

}  // namespace lamina
