// What speaks for a loop, as columns of loops.csv: those of a run and those of a merge.
#pragma once

#include <string>

#include "backend/submaps/submap_registration.h"

namespace lamina {

// The names, and the values of a match, without a comma at either end.
inline constexpr const char* kLoopEvidenceColumns =
    "planes,overlap,structure,residual_sigmas,facing,gone,looks,x,y,z,qx,qy,qz,qw";
std::string LoopEvidence(const SubmapMatch& match);

}  // namespace lamina
