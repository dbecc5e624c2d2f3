// The part of Mapping that finds pieces: in a finished map, or in those that are being made.
#include <algorithm>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "backend/localisation/lost_searches.h"
#include "backend/localisation/piece_searches.h"
#include "backend/loops/piece_loops.h"
#include "backend/mapping/mapping.h"
#include "backend/mapping/recording.h"

namespace lamina {

bool Mapping::IsMapped(std::int64_t piece) const {
  return std::any_of(recordings_->begin(), recordings_->end(), [&](const auto& named) {
    return named.second.piece == piece && named.second.mapper != nullptr;
  });
}

bool Mapping::IsSilent(const Recording& recording, std::size_t scan) const {
  return recording.over || static_cast<std::int64_t>(scan) - recording.last_scan > SilentScans();
}

std::vector<std::int64_t> Mapping::SilentPiecesBefore(const MappedScan& scan) const {
  std::vector<std::int64_t> pieces = loops_->PiecesBefore(scan.piece, scan.stamp_ns);
  for (const auto& [name, recording] : *recordings_) {
    if (recording.mapper == nullptr) continue;
    if (!IsSilent(recording, scan.index) || recording.last_stamp_ns >= scan.stamp_ns)
      pieces.erase(std::remove(pieces.begin(), pieces.end(), recording.piece), pieces.end());
  }
  return pieces;
}

void Mapping::Rest(const std::vector<std::int64_t>& pieces, std::size_t scan) {
  for (auto& [name, recording] : *recordings_) {
    const bool among = std::count(pieces.begin(), pieces.end(), recording.piece) > 0;
    if (!among || recording.mapper == nullptr) continue;
    recording.mapper->FinishSolves();
    // The poses of a recording that was silent for long are final, and were kept by SolveSilent().
    Trajectory last = recording.LastPoses();
    if (!last.empty()) recording.last = std::move(last);
    End(&recording, scan);
    recording.mapper.reset();
    recording.stream = next_stream_++;
  }
}

bool Mapping::Wake(Recording* recording) {
  const std::int64_t piece = recording->piece;
  if (!recording->last.empty() && loops_->Find(piece) != nullptr && !IsMapped(piece)) {
    GoOnIn(piece, recording->last, recording);
    return true;
  }
  if (!map_.RoomForPiece()) return false;
  BeginPiece(SE3(), recording);
  return true;
}

void Mapping::FindPlace(Recording* recording, const MappedScan& report) {
  if (!report.keyframe) return;
  if (searches_ != nullptr) {
    FindInMap(recording, report);
  } else if (loops_ != nullptr) {
    FindInOlderPieces(recording, report);
  }
}

void Mapping::FindInMap(Recording* recording, const MappedScan& report) {
  PlaceSearch* const search = searches_->Find(report.piece);
  if (search == nullptr) return;
  search->CountKeyframe(report.odometry.T_world_lidar);
  if (!search->Due()) return;
  const std::optional<FoundPlace> found =
      searches_->Look(search, recording->mapper->mapper().WindowKeyframes(), map_);
  TakeLook(found, *search, recording, report);
}

void Mapping::FindInOlderPieces(Recording* recording, const MappedScan& report) {
  const std::vector<std::int64_t> among = SilentPiecesBefore(report);
  if (among.empty()) return;
  lost_searches_->Begin(report.piece);
  const LostSearches::Step step =
      lost_searches_->Advance(report.piece, report.odometry.T_world_lidar);
  if (step == LostSearches::Step::kLookIsDue) {
    Rest(among, report.index);
    lost_searches_->BeginLook(report.piece, recording->mapper->mapper().WindowKeyframes(), among,
                              *loops_);
  } else if (step == LostSearches::Step::kLookHasEnded) {
    std::optional<FoundPlace> found = lost_searches_->found(report.piece);
    // Another recording may have gone on in that piece meanwhile.
    if (found && IsMapped(found->piece)) found.reset();
    TakeLook(found, lost_searches_->search(report.piece), recording, report);
  }
}

void Mapping::TakeLook(const std::optional<FoundPlace>& found, const PlaceSearch& search,
                       Recording* recording, const MappedScan& report) {
  if (callbacks_.on_look) {
    callbacks_.on_look({report.index, report.piece, search.reason(), found, search.candidates()});
  }
  if (found) GoOnAt(*found, recording, report);
}

void Mapping::GoOnAt(const FoundPlace& found, Recording* recording, const MappedScan& report) {
  const bool localising = searches_ != nullptr;
  // The place was found in the map as loops have corrected it; scans go on in the frame of its
  // odometry.
  const SE3 T_world_own =
      localising ? found.T_piece_own
                 : loops_->Find(found.piece)->T_map_world().Inverse() * found.T_piece_own;
  Trajectory last = recording->LastPoses();
  for (StampedPose& pose : last) pose.T_world_lidar = T_world_own * pose.T_world_lidar;
  End(recording, report.index);
  ++counts_.found;
  recording->stream = next_stream_++;
  if (localising) {
    recording->piece = found.piece;
    recording->mapper.reset();
    map_.ErasePiece(report.piece);
    recording->localiser = std::make_unique<Localiser>(options_.mapper, &map_, found.piece);
    recording->localiser->Start(last);
  } else {
    GoOnIn(found.piece, last, recording);
  }
}

void Mapping::GoOnIn(std::int64_t piece, const Trajectory& last, Recording* recording) {
  lost_searches_->WaitForLooks();
  recording->piece = piece;
  map_.SelectPiece(piece);
  const auto parts = loops_->Track(piece)->Resume(last.back().T_world_lidar.t);
  if (parts) map_.ReplaceFixed(*parts);
  MakeMapper(SE3(), recording);
  recording->mapper->mapper().Resume(last, loops_->NextKeyframe(piece));
}

}  // namespace lamina
