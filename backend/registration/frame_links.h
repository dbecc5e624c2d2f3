// Links of a registration: pairs of frames that see planes together.
//
// Planes are associated where clusters meet in a voxel, which says something while two frames are
// off against each other by less than its size. A link that solves have carried farther than that
// since it began was made of something else, such as road that looks alike everywhere, and so are
// the planes that it shares: it is cut, and each of its planes becomes two. What is left without
// links then is apart, and stays where it was (backend/bundle/uncertainty/observability.h).
//
// How far frames j and k have moved against each other is measured half-way between them, where
// what both see tends to be:
//
//     d = |T_j' T_j^-1 m - T_k' T_k^-1 m|,     m = (t_j + t_k) / 2
//
// so that a chain may swing as a whole by any angle.
//
// Private to backend/registration.
#pragma once

#include <algorithm>
#include <cstddef>
#include <map>
#include <set>
#include <utility>
#include <vector>

#include "backend/bundle/problem.h"

namespace lamina {

class FrameLinks {
 public:
  // Links that are new begin at the poses of the problem.
  void Add(const BundleProblem& problem);
  // Cuts the links that these poses have carried farther than that. Returns how many.
  std::size_t CutFarther(const std::vector<SE3>& poses, double max_m, double max_rad);
  // Whether these poses carry any link farther than that that is not cut.
  bool AnyFarther(const std::vector<SE3>& poses, double max_m, double max_rad) const;
  // Takes what is cut out of a problem: observations of a plane that no uncut link joins go to
  // different planes, and those that are left alone go.
  void Apply(BundleProblem* problem) const;
  // Root mean square of the motion of each frame against the nearest one before it that it is
  // linked with.
  struct Motion {
    double m = 0.0, rad = 0.0;
  };
  Motion Between(const std::vector<SE3>& before, const std::vector<SE3>& after) const;

  bool IsCut(int a, int b) const { return cut_.count({std::min(a, b), std::max(a, b)}) > 0; }

 private:
  struct Begin {
    SE3 T_world_a, T_world_b;
  };
  std::map<std::pair<int, int>, Begin> links_;  // lower frame first
  std::set<std::pair<int, int>> cut_;
};

}  // namespace lamina
