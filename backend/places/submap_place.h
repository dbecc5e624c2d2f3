// What a submap is recognised and registered by.
#pragma once

#include <vector>

#include "backend/places/place_image.h"
#include "backend/submaps/submap.h"
#include "backend/submaps/submap_registration.h"

namespace lamina {

// The image of a submap from above; `planes`: its LeafPlanes. `before`, `image_before`: the submap
// before it in its piece; null for the first one. It has told which way is up, but for what a short
// way can turn it by; the first one's anchor tells that within options.max_tilt_deg. Pure function.
PlaceImage ImageOfSubmap(const Submap& submap, const std::vector<LeafPlane>& planes,
                         const Submap* before, const PlaceImage* image_before,
                         const PlaceOptions& options);

// Its clusters, level by that image. Pure function.
SubmapQuery QueryOfSubmap(const Submap& submap, std::vector<LeafPlane> planes,
                          const PlaceImage& image);

}  // namespace lamina
