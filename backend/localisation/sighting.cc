#include "backend/localisation/sighting.h"

#include <algorithm>

#include "core/base/angle.h"

namespace lamina {
namespace {

// What a submap must show beyond the gates of loops: planes that agree as rarely as in a wood are
// made up for by all else.
constexpr double kOverlap = 0.85, kStructure = 0.75, kFactor = 1.5;
constexpr double kRoughOverlap = 0.3, kRoughMet = 0.97, kRoughMostGone = 0.03;
constexpr double kSameM = 0.7, kSameDeg = 3.0;
// What contradicts a rival, of what contradicts the best: as a factor, and more. A pose so near
// that the descent should have come from one to the other must be as good.
constexpr double kRivalFactor = 2.5, kRivalMore = 0.04;
constexpr double kBesideM = 2.5, kBesideDeg = 10.0, kBesideFactor = 1.3, kBesideMore = 0.02;

}  // namespace

bool SamePose(const SE3& a, const SE3& b, double most_m, double most_deg) {
  return AreClose(a, b, most_m, Radians(most_deg));
}

bool SamePose(const SE3& a, const SE3& b) { return SamePose(a, b, kSameM, kSameDeg); }

double Contradiction(const Sighting& sighting) { return 1.0 - sighting.met + sighting.gone; }

std::string StrictRefusal(const Sighting& sighting, const VerificationOptions& least) {
  const bool rough = sighting.met >= kRoughMet && sighting.gone <= kRoughMostGone;
  VerificationOptions strict = least;
  strict.min_planes = static_cast<int>(kFactor * least.min_planes);
  strict.min_facing *= kFactor;
  strict.min_overlap = rough ? kRoughOverlap : std::max(least.min_overlap, kOverlap);
  strict.min_overlap_none_gone = strict.min_overlap;
  strict.min_structure = std::max(least.min_structure, kStructure);
  strict.max_gone_agreeing = least.max_gone;
  if (sighting.met < kMet) return "the map has not what stands here";
  if (sighting.gone > kMostGone) return "what the map has does not stand here";
  return Refusal(sighting.match, strict);
}

bool IsRival(const Sighting& other, const Sighting& best) {
  if (!other.match.met_planes) return false;
  const bool one_piece = other.piece == best.piece;
  const SE3 &a = other.T_piece_submap, &b = best.T_piece_submap;
  if (one_piece && SamePose(a, b)) return false;
  const bool beside = one_piece && SamePose(a, b, kBesideM, kBesideDeg);
  const double least = Contradiction(best);
  return Contradiction(other) <= std::max((beside ? kBesideFactor : kRivalFactor) * least,
                                          least + (beside ? kBesideMore : kRivalMore));
}

namespace {

// The first one and its rivals.
std::vector<const Sighting*> Likely(const std::vector<Sighting>& sightings) {
  std::vector<const Sighting*> likely = {&sightings.front()};
  for (const Sighting& sighting : sightings) {
    if (&sighting != likely.front() && IsRival(sighting, *likely.front()))
      likely.push_back(&sighting);
  }
  return likely;
}

// Whether two of them are poses of one piece, and not the same.
bool TwoOfOnePiece(const std::vector<const Sighting*>& sightings) {
  for (std::size_t i = 0; i < sightings.size(); ++i) {
    for (std::size_t j = 0; j < i; ++j) {
      if (sightings[i]->piece == sightings[j]->piece &&
          !SamePose(sightings[i]->T_piece_submap, sightings[j]->T_piece_submap))
        return true;
    }
  }
  return false;
}

}  // namespace

bool NoRival(const std::vector<Sighting>& sightings) {
  const std::vector<const Sighting*> likely = Likely(sightings);
  return !TwoOfOnePiece(likely) &&
         std::all_of(likely.begin() + 1, likely.end(),
                     [](const Sighting* sighting) { return sighting->same_as_best; });
}

std::optional<bool> Repeats(const std::vector<Sighting>& sightings) {
  const Sighting& best = sightings.front();
  if (!best.match.met_planes || best.met < kMet || best.gone > kMostGone) return std::nullopt;
  return TwoOfOnePiece(Likely(sightings));
}

}  // namespace lamina
