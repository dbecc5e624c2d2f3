// What is told of scans and solves while a recording is mapped, and what is counted.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>

#include "backend/bundle/solver/adjuster.h"
#include "backend/localisation/place_report.h"
#include "backend/mapping/final_poses.h"
#include "backend/mapping/mapped_scan.h"
#include "backend/submaps/final_keyframe.h"
#include "core/geometry/state_archive.h"

namespace lamina {

// A window that was solved.
struct SolveReport {
  std::size_t before_scan = 0;  // took effect before this scan
  std::size_t frames = 0, planes = 0, observations = 0;
  bool discarded = false;  // solved in vain: its frames had left the window
  BundleResult result;

  void Archive(StateArchive& a);
};

struct MappingCounts {
  std::size_t scans = 0, frames = 0;  // with and without those skipped
  std::size_t keyframes = 0, lost = 0, restarts = 0, degenerate = 0, searched = 0;
  std::size_t pieces = 0;  // of the map, begun
  std::size_t found = 0;   // pieces that a finished map showed the place of
  std::map<SkipReason, std::size_t> skipped;
  std::size_t solves = 0, failed_solves = 0, discarded_solves = 0;

  // Whether at most half of the frames leave a direction open: the way is more than a prediction.
  bool MostlyDetermined() const { return degenerate * 2 <= frames; }

  void Archive(StateArchive& a);
};

// All are called from one thread at a time, between two scans, when the mapping may be looked at.
// May be empty.
struct MappingCallbacks {
  std::function<void(const MappedScan&)> on_scan;  // each scan, in order
  // All that could be done before the next scan has been done, and the state may be saved.
  std::function<void()> on_scan_done;
  std::function<void(const FinalPose&)> on_final_pose;  // each scan, in order, somewhat later
  std::function<void(const SolveReport&)> on_solve;
  OnPlaceReport on_look;
  OnFinalKeyframe on_final_keyframe;  // each that leaves the window
};

}  // namespace lamina
