#include "backend/submaps/submap_pairs.h"

#include <map>

#include "backend/submaps/submap_place.h"
#include "core/base/parallel.h"

namespace lamina {

std::vector<SubmapMatch> RegisterPairs(const std::vector<const Submap*>& submaps,
                                       const std::vector<PlaceImage>& images,
                                       const std::vector<SubmapPair>& pairs,
                                       const SubmapRegistration& registration,
                                       const VoxelMapOptions& map) {
  std::map<std::size_t, std::vector<std::size_t>> by_target;
  for (std::size_t i = 0; i < pairs.size(); ++i) by_target[pairs[i].from].push_back(i);
  std::vector<const std::vector<std::size_t>*> groups;
  for (const auto& [target, members] : by_target) groups.push_back(&members);
  std::vector<SubmapMatch> matches(pairs.size());
  ParallelChunks(groups.size(), 1, [&](std::size_t g, std::size_t) {
    const SubmapTarget target(*submaps[pairs[groups[g]->front()].from], map);
    for (const std::size_t i : *groups[g]) {
      const std::size_t to = pairs[i].to;
      matches[i] =
          registration.Register(QueryOfSubmap(*submaps[to], LeafPlanes(*submaps[to]), images[to]),
                                target, pairs[i].T_from_to);
    }
  });
  return matches;
}

}  // namespace lamina
