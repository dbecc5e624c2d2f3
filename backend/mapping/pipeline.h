// The threads around a Mapping: scans are read and decoded ahead of their turn.
//
//     read + prepare + cluster    parallel over the next scans (Mapping::Decode)
//       -> odometry, window, map  serial, in the order of the scans (Mapping::Add)
//            -> bundle adjustment one window in flight, beside the next scans' odometry
//       -> callbacks              for each scan, in order, as soon as its pose is known
//
// Bounded: at most `pipeline.lookahead_scans` are between the first stage and the last, so
// back-pressure reaches the reader. A window's correction takes effect a fixed number of frames
// after it was started, never "when it is ready". Therefore the result is the same, bit for bit, at
// any number of threads; and whether the scans are there at once or come one by one.
#pragma once

#include <atomic>
#include <cstddef>
#include <functional>

#include "backend/mapping/mapping.h"
#include "core/geometry/scan_source.h"

namespace lamina {

// Scans [next, end) of a source; the period of a sweep is learned from stamps from `begin` on.
struct ScanRange {
  std::size_t begin = 0, next = 0, end = 0;
};

// Maps scans that are there now; what is under way in the background stays so. Once `stop` is true,
// scans that have been read are still processed. `on_scan`, unless null, is given what Add returns
// of each. Returns the number of scans processed.
std::size_t MapScans(const ScanSource& source, const ScanRange& range, Mapping* mapping,
                     const std::atomic<bool>* stop = nullptr,
                     const std::function<void(const MappedScan&)>& on_scan = nullptr);

}  // namespace lamina
