#include "backend/places/submap_pairs.h"

#include <cstdint>
#include <map>

#include "backend/places/submap_place.h"
#include "core/base/parallel.h"

namespace lamina {

namespace {

// Those of the pairs at `mine`, in this order.
std::vector<SubmapMatch> RegisterSome(const std::vector<const Submap*>& submaps,
                                      const std::vector<PlaceImage>& images,
                                      const std::vector<SubmapPair>& pairs,
                                      const std::vector<std::size_t>& mine,
                                      const SubmapRegistration& registration,
                                      const VoxelMapOptions& map) {
  std::map<std::size_t, std::vector<std::size_t>> by_target;
  for (std::size_t i = 0; i < mine.size(); ++i) by_target[pairs[mine[i]].from].push_back(i);
  std::vector<const std::vector<std::size_t>*> groups;
  for (const auto& [target, members] : by_target) groups.push_back(&members);
  std::vector<SubmapMatch> matches(mine.size());
  ParallelChunks(groups.size(), 1, [&](std::size_t g, std::size_t) {
    const SubmapTarget target(*submaps[pairs[mine[groups[g]->front()]].from], map);
    for (const std::size_t i : *groups[g]) {
      const SubmapPair& pair = pairs[mine[i]];
      matches[i] = registration.Register(
          QueryOfSubmap(*submaps[pair.to], LeafPlanes(*submaps[pair.to]), images[pair.to]), target,
          pair.T_from_to);
    }
  });
  return matches;
}

}  // namespace

void Archive(StateArchive& a, SubmapPair* pair) {
  std::uint64_t from = pair->from, to = pair->to;
  a(&from, &to, &pair->T_from_to, &pair->score);
  pair->from = static_cast<std::size_t>(from);
  pair->to = static_cast<std::size_t>(to);
}

void Archive(StateArchive& a, SubmapMatch* match) {
  a(&match->T_other_query, &match->covariance, &match->met_planes, &match->planes, &match->overlap,
    &match->structure, &match->residual_sigmas, &match->facing, &match->gone, &match->looks);
}

std::vector<SubmapMatch> RegisterPairs(const std::vector<const Submap*>& submaps,
                                       const std::vector<PlaceImage>& images,
                                       const std::vector<SubmapPair>& pairs,
                                       const SubmapRegistration& registration,
                                       const VoxelMapOptions& map, const WorkSharing& sharing) {
  // All pairs of a target go to one process, which makes the target once.
  std::map<std::size_t, std::size_t> number;
  std::vector<std::size_t> owner;
  for (const SubmapPair& pair : pairs)
    owner.push_back(number.try_emplace(pair.from, number.size()).first->second % sharing.parts);
  return ShareOut<SubmapMatch>(owner, sharing, [&](const std::vector<std::size_t>& mine) {
    return RegisterSome(submaps, images, pairs, mine, registration, map);
  });
}

}  // namespace lamina
