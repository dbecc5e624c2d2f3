// Which planes take part in an adjustment, and how far they are trusted.
#pragma once

#include <vector>

#include "backend/bundle/problem.h"

namespace lamina {

// Leaves out planes that one frame alone sees, which bind nothing; of more than `most`, those seen
// by most frames stay.
void KeepBinding(int most, std::vector<Plane>* planes);

// Noise, which all planes share, averages out over points and frames; what thickens few of them far
// beyond the rest is structure: stairs, furniture and edges that a coarse voxel takes for a plane.
// Each place sees another side of it, so its error is the same for all points of a frame, and no
// number of points makes up for that. Three quarters of the planes say what thickness is usual
// here; beyond some times that variance the weight falls by its fourth power on top of 1/variance.
void DistrustThick(std::vector<Plane>* planes);

}  // namespace lamina
