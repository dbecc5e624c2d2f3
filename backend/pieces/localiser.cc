#include "backend/pieces/localiser.h"

#include <utility>

#include "backend/pieces/sweep_stamp.h"

namespace lamina {

Localiser::Localiser(const MapperOptions& options, VoxelMap* map, std::int64_t piece)
    : map_(map), piece_(piece), tracker_(options) {}

void Localiser::Start(const SE3& T_world_lidar) {
  may_restart_ = false;
  tracker_.odometry().StartAt(T_world_lidar);
}

void Localiser::Start(const Trajectory& last) { tracker_.StartAfter(last); }

RegisteredScan Localiser::Process(const MapperScan& scan, bool may_restart) {
  map_->SelectPiece(piece_);
  RegisteredScan result;
  OdometryFrame& frame = result.odometry;
  frame = tracker_.Register(scan.stamp_ns + scan.middle_ns, scan.stamp_made_up, *scan.clusters,
                            map_, /*map_is_older=*/true);
  if (frame.status == OdometryFrame::Status::kLost) {
    tracker_.Lose(frame, *scan.clusters);
    if (may_restart && may_restart_ && tracker_.MayRestart(/*matched=*/true))
      result.ends = PieceEnd::kUnconnected;
  } else {
    tracker_.Accept(frame);
  }
  map_->Refresh();  // what was brought back
  MoveToStamp(scan.middle_ns, &frame);
  if (result.ends == PieceEnd::kNone) final_.push_back({scan.stamp_ns, frame.T_world_lidar});
  return result;
}

Trajectory Localiser::TakeFinal() { return std::exchange(final_, {}); }

void Localiser::Archive(StateArchive& a) { a(&tracker_, &may_restart_, &final_); }

}  // namespace lamina
