#include "frontend/matching/profile_rows.h"

#include <algorithm>

#include "core/base/processor.h"
#include "core/geometry/cluster_lanes.h"
#include "core/geometry/degeneracy.h"
#include "frontend/matching/line_of_sight.h"

namespace lamina {
namespace {

// The numbers of four planes.
struct alignas(32) ProfilePlaneLanes {
  Four normal[3], leak2, mean[3], variance, flatness, weight;

  [[gnu::always_inline]] inline void Load(const ProfilePlane* const* of) {
    const double* place[4] = {of[0]->normal, of[1]->normal, of[2]->normal, of[3]->normal};
    Four columns[4];
    LoadColumns(place, columns);
    normal[0] = columns[0], normal[1] = columns[1], normal[2] = columns[2], leak2 = columns[3];
#pragma GCC unroll 4
    for (int k = 0; k < 4; ++k) place[k] = of[k]->mean;
    LoadColumns(place, columns);
    mean[0] = columns[0], mean[1] = columns[1], mean[2] = columns[2], variance = columns[3];
#pragma GCC unroll 4
    for (int k = 0; k < 4; ++k) place[k] = &of[k]->flatness;
    LoadColumns(place, columns);
    flatness = columns[0], weight = columns[1];
  }
};

}  // namespace

// Sums in the order in which Eigen takes those of DirectionProfile's other parts.
LAMINA_FOR_EACH_PROCESSOR
void MakeProfileRows(const PointCluster* const* clusters, const ProfilePlane* const* planes,
                     std::size_t count, const ProfilePlace& place, ProfileRow* rows) {
  MotionLanes at;
  at.Set(place.R, place.t);
  const Vector6d& d = place.direction;
  for (std::size_t i = 0; i < count; i += 4) {
    std::size_t of[4];
    for (std::size_t k = 0; k < 4; ++k) of[k] = std::min(i + k, count - 1);
    const ProfilePlane* const met[4] = {planes[of[0]], planes[of[1]], planes[of[2]], planes[of[3]]};
    ClusterLanes cluster;
    cluster.Load(NumbersOf(*clusters[of[0]]), NumbersOf(*clusters[of[1]]),
                 NumbersOf(*clusters[of[2]]), NumbersOf(*clusters[of[3]]));
    ProfilePlaneLanes plane;
    plane.Load(met);
    const Four *const mu = cluster.mean, *const s = cluster.scatter, *const nu = plane.normal;
    Four normal[3], turn[3];  // the normal in the LiDAR frame, and how a turn moves the cluster
#pragma GCC unroll 3
    for (int a = 0; a < 3; ++a)
      normal[a] = at.R[0][a] * nu[0] + (at.R[1][a] * nu[1] + at.R[2][a] * nu[2]);
#pragma GCC unroll 3
    for (int a = 0; a < 3; ++a) {
      const int b = (a + 1) % 3, c = (a + 2) % 3;
      turn[a] = (mu[b] * normal[c] - mu[c] * normal[b]) / kRotationArmM;
    }
    const Four along = (turn[0] * d(0) + (turn[2] * d(2) + nu[1] * d(4))) +
                       (turn[1] * d(1) + (nu[0] * d(3) + nu[2] * d(5)));
    const Four counting = along * along - plane.leak2;
    const Four across[3] = {s[0] * normal[0] + s[1] * normal[1] + s[2] * normal[2],
                            s[1] * normal[0] + s[3] * normal[1] + s[4] * normal[2],
                            s[2] * normal[0] + s[4] * normal[1] + s[5] * normal[2]};
    const Four spread = normal[0] * across[0] + normal[1] * across[1] + normal[2] * across[2];
    // DistanceVariance.
    const Four variance = place.floor2 + plane.variance + spread / cluster.count;
    const Four inverse_scale2 = 1.0 / (kProfileSigma * kProfileSigma * variance);
    // SightWeight.
    const Four sine = normal[0] * mu[0] + normal[1] * mu[1] + normal[2] * mu[2];
    const Four sight2 = mu[0] * mu[0] + mu[1] * mu[1] + mu[2] * mu[2];
    const Four sine2 = sine * sine;
    const Four sight = sine2 / (sine2 + plane.flatness * sight2 + kAtSensorM2);
    const Four points =
        cluster.count > kProfileMostPoints ? Four{} + kProfileMostPoints : cluster.count;
    const Four weight =
        plane.weight * sight * counting * points * kProfileSigma * kProfileSigma * inverse_scale2;
    Four off[3];
    for (int a = 0; a < 2; ++a)
      off[a] = at.R[a][0] * mu[0] + at.R[a][1] * mu[1] + at.R[a][2] * mu[2];
    off[2] = at.R[2][0] * mu[0] + (at.R[2][1] * mu[1] + at.R[2][2] * mu[2]);
    for (int a = 0; a < 3; ++a) off[a] = off[a] + at.t[a] - plane.mean[a];
    const Four distance = nu[0] * off[0] + (nu[1] * off[1] + nu[2] * off[2]);
    // GemanMcClureFit.
    const Four loss = 0.5 - 1.0 / (1.0 + distance * distance * inverse_scale2);
    const FourIntegers silent =
        (counting < kLeastCounting) | (sine2 < kFlatSine * kFlatSine * sight2);
    for (std::size_t k = 0; k < 4 && i + k < count; ++k)
      rows[i + k] = {silent[k] == 0, weight[k], loss[k]};
  }
}

}  // namespace lamina
