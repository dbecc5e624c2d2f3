// Many pairs of submaps, each registered from a pose of its own (submap_registration.h).
#pragma once

#include <cstddef>
#include <vector>

#include "backend/places/place_image.h"
#include "backend/submaps/submap.h"
#include "backend/submaps/submap_registration.h"
#include "backend/submaps/work_sharing.h"

namespace lamina {

struct SubmapPair {
  std::size_t from = 0, to = 0;  // positions of the target and of the query
  SE3 T_from_to;                 // where the descent starts
  double score = 0.0;            // of the images
};

void Archive(StateArchive& a, SubmapPair* pair);
void Archive(StateArchive& a, SubmapMatch* match);

// In the order of the pairs. Each target is made once and dropped when it is done with: memory is
// that of some submaps, however many pairs there are. Targets are shared out. Pure function; the
// same bits at any number of threads and processes.
std::vector<SubmapMatch> RegisterPairs(const std::vector<const Submap*>& submaps,
                                       const std::vector<PlaceImage>& images,
                                       const std::vector<SubmapPair>& pairs,
                                       const SubmapRegistration& registration,
                                       const VoxelMapOptions& map, const WorkSharing& sharing);

}  // namespace lamina
