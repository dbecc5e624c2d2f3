// Motions of whole groups of frames that no plane resists.
//
// Each frame of a room may be determined by what it shares with others of the same room, while all
// that the room shares with the next one is a floor: then its frames slide on it as one. After what
// is rigid has been joined (rigid_groups.h), few groups are left, most often none beside the one
// that stands. Of these, the joint normal matrix with the planes eliminated is
//
//     H_gh = sum_planes weight A_g' (F_g [g = h] - F_g (sum F)^-1 F_h) A_h,      A = NormalMotion
//
// and a block Cholesky factorisation from the smallest group to the largest finds what is open: the
// pivot of a group is its information with the larger groups standing and the smaller ones
// following it as the planes have them. A motion along an eigenvector of the pivot, with what
// follows, is open if what counts of its information (tied_planes.h) leaves it less certain than
// `max_sigma_m`. It is then held, so that it is found once; there are as many of them as there are
// open directions in all.
//
// Private to backend/bundle/uncertainty.
#pragma once

#include <vector>

#include "backend/bundle/uncertainty/rigid_groups.h"

namespace lamina {

struct GroupSlide {
  std::vector<int> frames;  // that move, ascending
  // Their tangent vectors (core/geometry/se3.h) in this motion.
  std::vector<Vector6d> motion;
  HeldDirection hold;  // of the first of them, which holds all
  // The motion as a twist of the world about that frame's LiDAR: [rotation; translation].
  Vector6d twist = Vector6d::Zero();
  double sigma_m = 0.0;  // infinite where nothing resists it
};

// Slides of what does not stand in `rigid`, against what does; open[k] are the held directions of
// frame k. All stands afterwards.
std::vector<GroupSlide> FindSlides(const std::vector<SE3>& poses,
                                   const std::vector<std::vector<HeldDirection>>& open,
                                   double max_sigma_m, RigidGroups* rigid);

}  // namespace lamina
