// The part of Mapping that finds pieces: in a finished map, or in those that are being made.
#include <algorithm>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "backend/localisation/lost_searches.h"
#include "backend/localisation/piece_searches.h"
#include "backend/mapping/mapping.h"

namespace lamina {

PlaceSearch* Mapping::SearchOf(std::int64_t piece) {
  if (searches_ != nullptr) return searches_->Find(piece);
  return loops_ != nullptr ? lost_searches_->Find(piece) : nullptr;
}

void Mapping::FindPlace(Recording* recording, const MappedScan& report) {
  PlaceSearch* const search = SearchOf(report.piece);
  if (search == nullptr || !report.keyframe || !search->Due()) return;
  const std::vector<FinalKeyframe> window = recording->mapper->mapper().WindowKeyframes();
  const std::optional<FoundPlace> found = searches_ != nullptr
                                              ? searches_->Look(search, window, map_)
                                              : lost_searches_->Look(report.piece, window, *loops_);
  if (callbacks_.on_look) {
    callbacks_.on_look({report.index, report.piece, search->reason(), found, search->candidates()});
  }
  if (found) GoOnAt(*found, recording, report);
}

void Mapping::GoOnAt(const FoundPlace& found, Recording* recording, const MappedScan& report) {
  // Scans that say how the sensor moves.
  constexpr std::size_t kLast = 5;
  const bool localising = searches_ != nullptr;
  // Of the map as loops have corrected it, in the frame of its odometry.
  const SE3 T_world_own =
      localising ? found.T_piece_own
                 : loops_->Find(found.piece)->T_map_world().Inverse() * found.T_piece_own;
  Trajectory last = recording->OpenPoses();
  if (last.size() > kLast) last.erase(last.begin(), last.end() - kLast);
  for (StampedPose& pose : last) pose.T_world_lidar = T_world_own * pose.T_world_lidar;
  End(recording, report.index);
  ++counts_.found;
  recording->piece = found.piece;
  recording->stream = next_stream_++;
  if (localising) {
    recording->mapper.reset();
    map_.ErasePiece(report.piece);
    recording->localiser = std::make_unique<Localiser>(options_.mapper, &map_, found.piece);
    recording->localiser->Start(last);
  } else {
    auto& before = recording->before;
    *std::find(before.begin(), before.end(), found.piece) = report.piece;
    map_.SelectPiece(found.piece);
    const auto parts = loops_->Track(found.piece)->Resume(last.back().T_world_lidar.t);
    if (parts) map_.ReplaceFixed(*parts);
    recording->mapper = std::make_unique<PieceMapper>(options_.mapper, &map_, found.piece, SE3());
    ForwardFinalKeyframes(&recording->mapper->mapper());
    recording->mapper->mapper().Resume(last, loops_->NextKeyframe(found.piece));
  }
}

void Mapping::ArchiveSearches(StateArchive& a) {
  bool any = searches_ != nullptr;
  a(&any);
  if (!any) return;
  if (a.reading()) {
    searches_ = std::make_unique<PieceSearches>(options_.loops, options_.mapper.odometry.matcher,
                                                options_.mapper.map.LeafSize());
  }
  searches_->Archive(a, map_);
}

}  // namespace lamina
