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

PlaceSearch* PieceSearches::Begin(std::int64_t piece) {
  return &searches_.try_emplace(piece, options_, leaf_size_m_).first->second;
}

void PieceSearches::Add(std::int64_t piece, const FinalKeyframe& keyframe) {
  if (PlaceSearch* const search = Find(piece); search != nullptr) search->Add(keyframe);
}

PlaceSearch* PieceSearches::Find(std::int64_t piece) {
  const auto found = searches_.find(piece);
  return found == searches_.end() ? nullptr : &found->second;
}

void PieceSearches::Archive(StateArchive& a, const VoxelMap& map) {
  std::vector<MapPlace> places;
  if (places_ != nullptr) places = places_->places();
  a(&places);
  if (a.reading()) places_ = std::make_unique<PlaceIndex>(options_, matcher_, places, map);
  ArchiveByKey(a, &searches_, [&](std::int64_t piece) { return Begin(piece); });
}

}  // namespace lamina
