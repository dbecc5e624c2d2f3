#include "backend/submaps/association_rounds.h"

#include <algorithm>
#include <cmath>

namespace lamina {

PoseMoves MovesBetween(const std::vector<SE3>& from, const std::vector<SE3>& to) {
  PoseMoves moves;
  if (from.empty()) return moves;
  double m2 = 0.0, rad2 = 0.0;
  for (std::size_t i = 0; i < from.size(); ++i) {
    const double m = (to[i].t - from[i].t).norm(), rad = RotationAngle(to[i], from[i]);
    moves.largest_m = std::max(moves.largest_m, m);
    moves.largest_rad = std::max(moves.largest_rad, rad);
    m2 += m * m;
    rad2 += rad * rad;
  }
  const auto n = static_cast<double>(from.size());
  moves.rms_m = std::sqrt(m2 / n);
  moves.rms_rad = std::sqrt(rad2 / n);
  return moves;
}

}  // namespace lamina
