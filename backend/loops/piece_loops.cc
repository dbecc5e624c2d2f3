#include "backend/loops/piece_loops.h"

#include <algorithm>
#include <vector>

namespace lamina {

SE3 PieceCorrections::Corrected(std::int64_t piece, StampNs stamp_ns,
                                const SE3& T_world_lidar) const {
  const auto found = pieces.find(piece);
  return found == pieces.end() ? T_world_lidar : found->second.Corrected(stamp_ns, T_world_lidar);
}

PieceLoops::PieceLoops(const LoopOptions& options, const VoxelMapOptions& map,
                       const ScanMatcherOptions& matcher, ByteStore* store)
    : options_(options), map_(map), matcher_(matcher), store_(store) {
  CheckOptions(options, "loops");
}

LoopTrack* PieceLoops::Track(std::int64_t piece) {
  auto& track = tracks_[piece];
  if (track == nullptr) track = std::make_unique<LoopTrack>(options_, map_, matcher_, store_);
  return track.get();
}

const LoopTrack* PieceLoops::Find(std::int64_t piece) const {
  const auto found = tracks_.find(piece);
  return found == tracks_.end() ? nullptr : found->second.get();
}

std::vector<std::int64_t> PieceLoops::PiecesBefore(std::int64_t piece, StampNs stamp_ns) const {
  std::vector<std::int64_t> before;
  for (auto track = tracks_.begin(); track != tracks_.lower_bound(piece); ++track) {
    if (track->second->last_ns() < stamp_ns) before.push_back(track->first);
  }
  return before;
}

void PieceLoops::Finish() {
  for (auto& [piece, track] : tracks_) track->Finish();
}

std::int64_t PieceLoops::NextKeyframe(std::int64_t piece) const {
  const LoopTrack* const track = Find(piece);
  if (track == nullptr || track->closure().submaps().empty()) return 0;
  return track->closure().submaps().back().keyframes.back().id + 1;
}

std::map<std::int64_t, const LoopClosure*> PieceLoops::pieces() const {
  std::map<std::int64_t, const LoopClosure*> closures;
  for (const auto& [piece, track] : tracks_) closures[piece] = &track->closure();
  return closures;
}

SE3 PieceLoops::Corrected(std::int64_t piece, StampNs stamp_ns, const SE3& T_world_lidar) const {
  const LoopTrack* const track = Find(piece);
  return track == nullptr ? T_world_lidar : track->Corrected(stamp_ns, T_world_lidar);
}

PieceCorrections PieceLoops::Corrections() const {
  PieceCorrections corrections;
  for (const auto& [piece, track] : tracks_) {
    if (track->correction()) corrections.pieces.emplace(piece, *track->correction());
  }
  return corrections;
}

std::int64_t PieceLoops::corrections() const {
  std::int64_t sum = 0;
  for (const auto& [piece, track] : tracks_) sum += track->corrections();
  return sum;
}

void PieceLoops::AddCorrectedTo(VoxelMap* map) const {
  for (const auto& [piece, closure] : pieces()) {
    if (map->HasPiece(piece)) {
      map->SelectPiece(piece);
    } else {
      map->BeginPiece(piece);
    }
    AddToMap(closure->submaps(), closure->anchors(), map);
  }
}

std::vector<StoredBytes> PieceLoops::StoredPlaces() const {
  std::vector<StoredBytes> places;
  for (const auto& [piece, track] : tracks_) track->AddStoredPlaces(&places);
  return places;
}

void PieceLoops::Archive(StateArchive& a) {
  std::uint64_t stored = store_ == nullptr ? 0 : store_->size();
  a(&stored);
  if (a.reading() && store_ != nullptr) store_->RollBackTo(stored);
  ArchiveByKey(a, &tracks_, [&](std::int64_t piece) { return Track(piece); });
}

}  // namespace lamina
