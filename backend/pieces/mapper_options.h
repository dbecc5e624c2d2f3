// Options of mapping in one piece of the map, and of localising in it.
#pragma once

#include <optional>

#include "backend/bundle/solver/adjuster.h"
#include "backend/window/sliding_window.h"
#include "core/map/voxel_map.h"
#include "core/options/options.h"
#include "frontend/odometry/odometry_options.h"

namespace lamina {

struct BackendOptions {
  // Off: poses stay as the frontend found them; everything else is the same.
  bool enabled = true;
  // A bundle adjustment starts every so many keyframes, and its result takes effect so many frames
  // later.
  int solve_every_keyframes = 5;
  int hand_over_lag_frames = 2;
  // A frame becomes a keyframe when it moved or turned so far from the last one. 0: every frame.
  double keyframe_translation_m = 0.03;
  double keyframe_rotation_deg = 0.3;
  // Also when so many frames have come since the last one: a sensor that stands still makes a map
  // of the place, too. 0: never for that reason.
  int keyframe_after_frames = 100;
  // A pose is final when so many scans have come after it, wherever the window stands.
  int final_after_frames = 300;
  // Lost for so many frames in a row, if the last ones agree with one another or more are lost than
  // were ever tracked: the next one begins a piece of its own, at its predicted pose.
  int restart_after_lost_frames = 20;
  // So does one that is less certain than this against what was mapped before a stretch of
  // degenerate scans, once scans determine all directions again (degenerate_stretch.h), and one
  // that may be in either of two places (ambiguous_place.h). 0: never.
  double restart_after_sigma_m = 0.1;
  // Frames that must have seen a plane before it counts as part of the map that is written out.
  int min_surfel_frames = 2;
  SlidingWindowOptions window;
  BundleAdjusterOptions solver;

  // Frames that a solve needs at least.
  static constexpr int kLeastSolved = 3;

  void Visit(OptionVisitor& v);
  // Throws OptionError, naming both, for options that contradict one another.
  void CheckTogether() const;
};

struct MapperOptions {
  VoxelMapOptions map;
  OdometryOptions frontend;
  BackendOptions backend;
  // Pieces are looked for in one another: lost where no search for the expected pose reaches, scans
  // begin a piece as soon as they agree. No option of files: Mapping sets it by loops.enabled.
  bool pieces_are_found = false;
  // The body velocity of the first scan, per second, where it is known beforehand, as from another
  // map of the same scans: nothing is searched for at the start then. No option of files.
  std::optional<Vector6d> start_velocity = std::nullopt;
};

}  // namespace lamina
