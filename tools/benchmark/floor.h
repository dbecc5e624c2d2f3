// The least that any method which gathers the points of a scan does: reads them from the file, and
// adds each once to the cluster (count, sum, sum of products) of its voxel, found in one hash
// table. What a pipeline takes a frame, over this, does not depend on the machine so much.
#pragma once

#include <cstddef>
#include <string>

namespace lamina {

class ScanSource;

struct Floor {
  double cpu_ms = 0.0;  // a scan, by the thread's CPU time
  double points = 0.0;  // a scan
  double clusters = 0.0;
};

// Over the first `frames` scans. Files of the layout of KITTI (.bin) are read without a detour,
// others by the source. Throws InputError.
Floor MeasureFloor(const ScanSource& source, std::size_t frames, double leaf_size_m);

}  // namespace lamina
