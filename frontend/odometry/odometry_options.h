// Options of odometry (odometry.h), those of motion, matching and search among them.
#pragma once

#include "core/options/options.h"
#include "frontend/matching/pose_search_options.h"
#include "frontend/matching/scan_matcher.h"
#include "frontend/odometry/motion_model.h"

namespace lamina {

struct OdometryOptions {
  // Number of times that a scan is deskewed and matched again with the motion just found.
  int deskew_passes = 1;
  // Lost when, after a search too, the share of inliers is below this part of its recent median ...
  double lost_inlier_ratio = 0.35;
  // ... or, where the prediction does not vouch for the match, if what meets a plane at all fits it
  // worse than this part of the recent median.
  double doubtful_fit_ratio = 0.85;
  // Distance from the prediction, in standard deviations, beyond which the prediction no longer
  // supports the match, and beyond which a match is degenerate along the direction that it knows
  // least.
  double max_prediction_sigmas = 4.5;
  // After a gap longer than this the prediction supports no match, ...
  double vouched_gap_s = 0.5;
  // ... and no direction may be known worse than this.
  double max_sigma_m = 0.3;
  // A scan is called tracked if planes know no direction of its pose worse than this; else it is
  // called degenerate, whether the prediction takes part or not. Of a pose that is to be within
  // 0.1 m it is a third: three standard deviations.
  double max_tracked_sigma_m = 0.033;
  MotionOptions motion;
  ScanMatcherOptions matcher;
  PoseSearchOptions search;

  void Visit(OptionVisitor& v);
};

}  // namespace lamina
