#include "backend/localisation/piece_searches.h"

namespace lamina {

PieceSearches::PieceSearches(const LoopOptions& options, const ScanMatcherOptions& matcher,
                             const std::vector<MapPlace>& places, const VoxelMap& map)
    : PieceSearches(options, matcher, map.options().LeafSize()) {
  places_ = std::make_unique<PlaceIndex>(options_, matcher_, places, map);
}

PieceSearches::PieceSearches(const LoopOptions& options, const ScanMatcherOptions& matcher,
                             double leaf_size_m)
    : options_(options), matcher_(matcher), leaf_size_m_(leaf_size_m) {}

void PieceSearches::Begin(std::int64_t piece) {
  searches_.try_emplace(piece, options_, leaf_size_m_);
}

PlaceSearch* PieceSearches::Find(std::int64_t piece) {
  const auto found = searches_.find(piece);
  return found == searches_.end() ? nullptr : &found->second;
}

void PieceSearches::Archive(StateArchive& a, const VoxelMap& map) {
  std::vector<MapPlace> places;
  if (places_ != nullptr) places = places_->places();
  std::vector<std::int64_t> pieces;
  for (const auto& [piece, search] : searches_) pieces.push_back(piece);
  a(&places, &pieces);
  if (a.reading()) {
    places_ = std::make_unique<PlaceIndex>(options_, matcher_, places, map);
    searches_.clear();
  }
  for (const std::int64_t piece : pieces) {
    Begin(piece);
    a(Find(piece));
  }
}

}  // namespace lamina
