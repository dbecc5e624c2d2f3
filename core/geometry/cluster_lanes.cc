#include "core/geometry/cluster_lanes.h"

#include <algorithm>

namespace lamina {

LAMINA_FOR_EACH_PROCESSOR
void MoveClusters(const PointCluster* from, std::size_t count, double most,
                  const Eigen::Matrix3d& R, const Eigen::Vector3d& t, PointCluster* to) {
  MotionLanes motion;
  motion.Set(R, t);
  PointCluster rest[4];
  for (std::size_t i = 0; i < count; i += 4) {
    const bool last = i + 4 > count;
    if (last) std::copy(from + i, from + count, rest);
    const PointCluster* const in = last ? rest : from + i;
    PointCluster* const out = last ? rest : to + i;
    ClusterLanes lanes;
    lanes.Load(NumbersOf(in[0]), NumbersOf(in[1]), NumbersOf(in[2]), NumbersOf(in[3]));
    lanes.Cap(most);
    lanes.Move(motion);
    lanes.Store(NumbersOf(out[0]), NumbersOf(out[1]), NumbersOf(out[2]), NumbersOf(out[3]));
    if (last) std::copy(rest, rest + (count - i), to + i);
  }
}

}  // namespace lamina
