// Options of the search for a scan's pose: when it is started, where it looks, how much it refines.
#pragma once

#include "core/options/options.h"

namespace lamina {

struct PoseSearchOptions {
  bool enabled = true;
  // Started when match and prediction differ by more than this, or ...
  double trigger_rotation_deg = 2.0;
  double trigger_translation_m = 0.5;
  // ... the share of inliers is below this part of its recent median.
  double trigger_inlier_ratio = 0.85;
  // Turns: -range, ..., -step, 0, step, ..., range about each axis.
  double range_deg = 15.0;
  double step_deg = 5.0;
  // Least number of clusters that are scored for each hypothesis, if there are so many, at most
  // twice as many; and the scale of the score.
  int clusters = 400;
  double score_scale_m = 0.2;
  // Hypotheses refined by matching.
  int refined = 6;
  // While no speed is known: offsets along x and y of the sensor, -range, ..., range.
  double range_m = 3.0;
  double step_m = 0.5;
  // After a gap: offsets along the way, as far as the prediction is uncertain, but no farther.
  double max_way_m = 50.0;

  void Visit(OptionVisitor& v);
};

}  // namespace lamina
