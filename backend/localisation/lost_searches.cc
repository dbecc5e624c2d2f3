#include "backend/localisation/lost_searches.h"

#include <utility>

namespace lamina {
namespace {

// Keyframes until a look has ended: half of those between two looks.
constexpr int kLagKeyframes = 5;

PlaceSource::Pieces PiecesOf(const std::vector<std::int64_t>& among, const PieceLoops& loops) {
  PlaceSource::Pieces pieces;
  for (const std::int64_t piece : among) {
    const LoopTrack* const track = loops.Find(piece);
    if (track != nullptr && !track->closure().submaps().empty()) pieces[piece] = &track->closure();
  }
  return pieces;
}

// What an index is made of: a piece that has been mapped further since, or corrected, is another.
struct IndexedPiece {
  std::int64_t piece = 0, next_keyframe = 0, corrections = 0;

  bool operator==(const IndexedPiece& other) const {
    return piece == other.piece && next_keyframe == other.next_keyframe &&
           corrections == other.corrections;
  }
};

}  // namespace

struct LostSearches::Search {
  Search(const LoopOptions& options, double leaf_size_m) : search(options, leaf_size_m) {}

  PlaceSearch search;
  bool under_way = false;
  int keyframes_since_begin = 0;
  std::optional<FoundPlace> found;  // by the last look
  std::vector<IndexedPiece> of;
  std::unique_ptr<PlaceIndex> places;  // made for the first look, and anew where `of` has changed
  Background background;               // the last member: it waits before what it works on goes

  void Archive(StateArchive& a) {
    background.Wait();
    bool any = found.has_value();
    a(&search, &under_way, &keyframes_since_begin, &any);
    if (a.reading()) found = any ? std::make_optional<FoundPlace>() : std::nullopt;
    if (any) a(&*found);
  }
};

LostSearches::LostSearches(const LoopOptions& options, const ScanMatcherOptions& matcher,
                           const VoxelMapOptions& map)
    : options_(options), matcher_(matcher), map_(map) {}

LostSearches::~LostSearches() = default;

void LostSearches::Begin(std::int64_t piece) {
  auto& search = searches_[piece];
  if (search == nullptr) search = std::make_unique<Search>(options_, map_.LeafSize());
}

void LostSearches::End(std::int64_t piece) {
  const auto ends = searches_.find(piece);
  if (ends == searches_.end()) return;
  ends->second->background.Wait();
  if (ends->second->search.ambiguous()) ambiguous_.insert(piece);
  searches_.erase(ends);
}

void LostSearches::Add(std::int64_t piece, const FinalKeyframe& keyframe) {
  const auto looked_for = searches_.find(piece);
  if (looked_for != searches_.end()) looked_for->second->search.Add(keyframe);
}

LostSearches::Step LostSearches::Advance(std::int64_t piece, const SE3& T_own_lidar) {
  Search& search = *searches_.at(piece);
  search.search.CountKeyframe(T_own_lidar);
  if (!search.under_way) return search.search.Due() ? Step::kLookIsDue : Step::kNothing;
  if (++search.keyframes_since_begin < kLagKeyframes) return Step::kNothing;
  search.background.Wait();
  search.under_way = false;
  return Step::kLookHasEnded;
}

void LostSearches::BeginLook(std::int64_t piece, std::vector<FinalKeyframe> window,
                             const std::vector<std::int64_t>& among, const PieceLoops& loops) {
  Search& search = *searches_.at(piece);
  PlaceSource::Pieces pieces = PiecesOf(among, loops);
  std::vector<IndexedPiece> of;
  for (const auto& [other, closure] : pieces)
    of.push_back({other, loops.NextKeyframe(other), loops.Find(other)->corrections()});
  if (search.of != of) search.places.reset();
  search.of = std::move(of);
  search.under_way = true;
  search.keyframes_since_begin = 0;
  search.background.Start([this, &search, source = PlaceSource(pieces, map_, ambiguous_), pieces,
                           query = search.search.BeginLook(std::move(window))] {
    if (search.places == nullptr)
      search.places = std::make_unique<PlaceIndex>(options_, matcher_, pieces, map_);
    search.found = search.search.Look(query, *search.places, source);
  });
}

void LostSearches::WaitForLooks() {
  for (auto& [piece, search] : searches_) search->background.Wait();
}

const std::optional<FoundPlace>& LostSearches::found(std::int64_t piece) const {
  return searches_.at(piece)->found;
}

const PlaceSearch& LostSearches::search(std::int64_t piece) const {
  return searches_.at(piece)->search;
}

void LostSearches::Archive(StateArchive& a) {
  ArchiveByKey(a, &searches_, [&](std::int64_t piece) {
    if (a.reading()) Begin(piece);
    return searches_.at(piece).get();
  });
  std::vector<std::int64_t> ambiguous(ambiguous_.begin(), ambiguous_.end());
  a(&ambiguous);
  ambiguous_ = std::set<std::int64_t>(ambiguous.begin(), ambiguous.end());
}

}  // namespace lamina
