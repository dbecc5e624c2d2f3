// Poses of scans in their order, each handed on once it is final.
//
// Scans come in one by one, with a pose of their own to follow or without (skipped). Poses come
// later, when bundle adjustment is done with them. A skipped scan gets a pose between those of its
// neighbours: by stamp where that is possible, else the one before it (for the first scans: after).
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>

#include "core/scan.h"
#include "core/state_archive.h"

namespace lamina {

struct FinalPose {
  std::size_t scan = 0;  // its number, as given to AddScan
  StampedPose pose;
  bool skipped = false;  // the pose is not of its own points
};

// Not thread-safe. Memory: the scans that are not final.
class FinalPoses {
 public:
  using Visit = std::function<void(const FinalPose&)>;

  void AddScan(std::size_t scan, StampNs stamp_ns, bool skipped);
  // The next poses, of the scans that were not skipped.
  void AddPoses(const Trajectory& poses, const Visit& visit);
  // What is left, given the poses that are still open, as if nothing were to come.
  void ShowOpen(const Trajectory& open, const Visit& visit) const;

  void Archive(StateArchive& a);

 private:
  struct Scan {
    std::size_t number = 0;
    StampNs stamp_ns = 0;
    bool skipped = false;
  };
  void Emit(const StampedPose& next, const Visit& visit);

  std::deque<Scan> open_;
  bool any_ = false;
  StampedPose last_;  // the last final pose of a scan's own, if any_
};

}  // namespace lamina
