#include "backend/localisation/lost_searches.h"

#include <utility>
#include <vector>

namespace lamina {
namespace {

PlaceSource::Pieces PiecesOf(const std::vector<std::int64_t>& among, const PieceLoops& loops) {
  PlaceSource::Pieces pieces;
  for (const std::int64_t piece : among) {
    const LoopTrack* const track = loops.Find(piece);
    if (track != nullptr && !track->closure().submaps().empty()) pieces[piece] = &track->closure();
  }
  return pieces;
}

}  // namespace

LostSearches::LostSearches(const LoopOptions& options, const ScanMatcherOptions& matcher,
                           const VoxelMapOptions& map)
    : options_(options), matcher_(matcher), map_(map) {}

void LostSearches::Begin(std::int64_t piece, const std::vector<std::int64_t>& among) {
  searches_.insert_or_assign(piece, Search{among, PlaceSearch(options_, map_.LeafSize()), nullptr});
}

void LostSearches::End(std::int64_t piece) {
  const PlaceSearch* const search = Find(piece);
  if (search != nullptr && search->ambiguous()) ambiguous_.insert(piece);
  searches_.erase(piece);
}

PlaceSearch* LostSearches::Find(std::int64_t piece) {
  const auto found = searches_.find(piece);
  return found == searches_.end() ? nullptr : &found->second.search;
}

std::optional<FoundPlace> LostSearches::Look(std::int64_t piece,
                                             const std::vector<FinalKeyframe>& window,
                                             const PieceLoops& loops) {
  Search& search = searches_.at(piece);
  const PlaceSource::Pieces pieces = PiecesOf(search.among, loops);
  if (search.places == nullptr)
    search.places = std::make_unique<PlaceIndex>(options_, matcher_, pieces, map_);
  return search.search.Look(window, *search.places, PlaceSource(pieces, map_, ambiguous_));
}

void LostSearches::Archive(StateArchive& a) {
  ArchiveByKey(a, &searches_, [&](std::int64_t piece) {
    if (a.reading()) Begin(piece, {});
    return &searches_.at(piece);
  });
  std::vector<std::int64_t> ambiguous(ambiguous_.begin(), ambiguous_.end());
  a(&ambiguous);
  ambiguous_ = std::set<std::int64_t>(ambiguous.begin(), ambiguous.end());
}

}  // namespace lamina
