#include "backend/pieces/mapper_options.h"

#include <string>

#include "core/base/error.h"

namespace lamina {

void BackendOptions::Visit(OptionVisitor& v) {
  v.Flag("enabled", &enabled);
  v.Integer("solve_every_keyframes", &solve_every_keyframes, 1, 1000);
  v.Integer("hand_over_lag_frames", &hand_over_lag_frames, 0, 100);
  v.Number("keyframe_translation_m", &keyframe_translation_m, 0.0, 100.0);
  v.Number("keyframe_rotation_deg", &keyframe_rotation_deg, 0.0, 180.0);
  v.Integer("keyframe_after_frames", &keyframe_after_frames, 0, 1000000);
  v.Integer("final_after_frames", &final_after_frames, 1, 1000000);
  v.Integer("restart_after_lost_frames", &restart_after_lost_frames, 0, 1000000);
  v.Number("restart_after_sigma_m", &restart_after_sigma_m, 0.0, 1e6);
  v.Integer("min_surfel_frames", &min_surfel_frames, 1, 1000);
  v.Group("window", &window);
  v.Group("solver", &solver);
}

void BackendOptions::CheckTogether() const {
  if (!enabled) return;
  const std::string frames = "backend.window.frames = " + std::to_string(window.frames);
  if (window.frames < kLeastSolved) {
    throw OptionError(frames + ": must be at least " + std::to_string(kLeastSolved) +
                      " while backend.enabled = true: bundle adjustment of fewer frames is never "
                      "begun");
  }
  if (hand_over_lag_frames >= window.frames) {
    throw OptionError(
        "backend.hand_over_lag_frames = " + std::to_string(hand_over_lag_frames) +
        ": must be less than " + frames +
        ": all frames of a solve could have left the window before its result takes effect");
  }
}

}  // namespace lamina
