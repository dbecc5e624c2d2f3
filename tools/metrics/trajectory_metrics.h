// How far an estimated trajectory is from a true one.
//
//   APE   absolute position error after alignment (Sturm et al., IROS 2012), metres
//   RPE   relative pose error over one frame (same source), metres and degrees
//   KITTI relative error over segments of given lengths (Geiger et al., CVPR 2012): for E =
//         (truth_i^-1 truth_j)^-1 (estimate_i^-1 estimate_j), with j the first frame at least L
//         metres along the truth after i: |trans(E)| / L in percent and angle(E) / L in deg/m
#pragma once

#include <string>
#include <vector>

#include "core/geometry/scan.h"

namespace lamina {

enum class Alignment {
  kSe3,    // least squares over all positions (Umeyama 1991, scale fixed at 1)
  kFirst,  // first poses made equal
  kNone,
};

struct SegmentError {
  double length_m = 0.0;
  double translation_percent = 0.0;  // mean over the segments of this length
  double rotation_deg_per_m = 0.0;
  int segments = 0;  // 0: the trajectory is too short, the means are NaN
};

struct TrajectoryErrors {
  int poses = 0;
  double length_m = 0.0;  // of the truth
  double ape_rmse_m = 0.0, ape_mean_m = 0.0, ape_max_m = 0.0;
  double rpe_rmse_m = 0.0, rpe_rmse_deg = 0.0;
  double first_to_last_m = 0.0;              // distance of the estimate's end from its start
  std::vector<SegmentError> short_segments;  // 5, 10, 20, 50 m, every frame a start
  std::vector<SegmentError> kitti_segments;  // 100, 200, ..., 800 m, every 10th frame a start
  double kitti_trel_percent = 0.0;  // mean over all segments of 100..800 m; NaN if there is none
  double kitti_rrel_deg_per_m = 0.0;
};

// Pose i of one belongs to pose i of the other: match them before, by MatchByStamp if counts
// differ. Throws InputError if fewer than 2 poses or counts differ.
TrajectoryErrors CompareTrajectories(const Trajectory& estimate, const Trajectory& truth,
                                     Alignment alignment);

// Keeps the pairs whose stamps differ by at most `tolerance_s`.
void MatchByStamp(double tolerance_s, Trajectory* estimate, Trajectory* truth);

// T with T * estimate ~ truth.
SE3 AlignTrajectories(const Trajectory& estimate, const Trajectory& truth, Alignment alignment);

}  // namespace lamina
