// Where a registration leaves what its planes do not determine.
//
// Private to backend/registration.
#pragma once

#include <vector>

#include "backend/bundle/uncertainty/observability.h"
#include "backend/registration/batch_frame.h"

namespace lamina {

// Groups found to slide go back, along the directions that are open, to where they began: earlier
// rounds may have taken thick planes for something that holds them.
void PutSlidesBack(const std::vector<BatchFrame>& frames, const std::vector<BundleFault>& faults,
                   std::vector<SE3>* poses);

// Frames that share no plane with the rest, but have been carried off by earlier rounds, which took
// something else for planes of both: each group goes back as one body, to where the initial poses
// have its first frame against the nearest frame before it that is none of them, or, if there is
// none, after it. What no round has moved stays at its initial pose.
void PutPartsBack(const std::vector<BatchFrame>& frames, const std::vector<BundleFault>& faults,
                  std::vector<SE3>* poses);

}  // namespace lamina
