#include "backend/bundle/uncertainty/tied_planes.h"

#include <Eigen/LU>
#include <algorithm>

#include "core/base/parallel.h"
#include "core/geometry/degeneracy.h"

namespace lamina {
namespace {

// Of points in the world.
Symmetric3 Moments(const TiedPlane& plane, const PointCluster& cluster) {
  const Eigen::Vector3d d = cluster.mean - plane.mean;
  const Eigen::Vector3d at(1.0, d.dot(plane.u1), d.dot(plane.u2));
  Eigen::Matrix3d F = cluster.count * at * at.transpose();
  const Eigen::Vector3d S1 = cluster.scatter * plane.u1, S2 = cluster.scatter * plane.u2;
  F(1, 1) += plane.u1.dot(S1);
  F(2, 2) += plane.u2.dot(S2);
  F(1, 2) += plane.u1.dot(S2);
  return Symmetric3::FromDense(F);
}

// Adds a share to that of the same group.
void Add(const PlaneShare& from, PlaneShare* to) {
  const double n = to->moments.xx + from.moments.xx;
  if (n > 0.0) to->origin += (from.moments.xx / n) * (from.origin - to->origin);
  to->moments += from.moments;
}

// Calls share(group, observation) for each share of a plane of the problem; the observation is null
// for what is fixed.
template <typename Share>
void ForEachShare(const BundleProblem& problem, const Plane& plane,
                  const std::vector<int>& group_of, int fixed_group, const Share& share) {
  if (!plane.fixed.Empty()) share(fixed_group, nullptr);
  for (int i = plane.first; i < plane.first + plane.count; ++i) {
    const PlaneObservation& o = problem.observations[static_cast<std::size_t>(i)];
    const int group = group_of[static_cast<std::size_t>(o.frame)];
    if (group >= 0 && !o.cluster.Empty()) share(group, &o);
  }
}

void Append(TiedPlane plane, const std::vector<PlaneShare>& shares, TiedPlanes* tied) {
  if (shares.size() < 2) return;
  plane.first = static_cast<std::int32_t>(tied->shares.size());
  plane.count = static_cast<std::int32_t>(shares.size());
  tied->planes.push_back(plane);
  tied->shares.insert(tied->shares.end(), shares.begin(), shares.end());
}

}  // namespace

Eigen::Matrix3d TiedPlane::Motion(const Eigen::Vector3d& c, const Vector6d& twist) const {
  const Eigen::Vector3d w = twist.head<3>() / kRotationArmM;
  const Eigen::Vector3d d = twist.tail<3>() + w.cross(mean - c);
  const double w1 = w.dot(u1), w2 = w.dot(u2), wn = w.dot(normal);
  Eigen::Matrix3d Y;
  Y << d.dot(normal), d.dot(u1), d.dot(u2),  //
      -w2, 0.0, wn,                          //
      w1, -wn, 0.0;
  return Y;
}

Eigen::Matrix<double, 3, 6> TiedPlane::NormalMotion(const Eigen::Vector3d& c) const {
  Eigen::Matrix<double, 3, 6> A = Eigen::Matrix<double, 3, 6>::Zero();
  A.row(0) << (mean - c).cross(normal).transpose() / kRotationArmM, normal.transpose();
  A.row(1).head<3>() = -u2.transpose() / kRotationArmM;
  A.row(2).head<3>() = u1.transpose() / kRotationArmM;
  return A;
}

double TiedPlane::Information(const Eigen::Vector3d& E) const {
  return weight * std::max(0.0, E(0) - normal_error2 * E.sum());
}

TiedPlanes TiePlanes(const BundleProblem& problem, const std::vector<PlaneFrame>& frames,
                     const std::vector<int>& group_of, int fixed_group) {
  constexpr std::size_t kChunk = 64;  // planes
  const PoseMatrices poses(problem.poses);
  // First where the shares of each plane go, so that they are made in their place.
  TiedPlanes tied;
  std::vector<std::size_t> of;  // the problem's plane of each
  std::int32_t first = 0;
  for (std::size_t p = 0; p < frames.size(); ++p) {
    const PlaneFrame& f = frames[p];
    TiedPlane plane{f.normal, f.u1, f.u2, f.mean};
    ForEachShare(problem, problem.planes[p], group_of, fixed_group,
                 [&](int, const PlaneObservation*) { ++plane.count; });
    if (plane.count < 2) continue;
    plane.weight = problem.planes[p].weight;
    plane.normal_error2 = NormalError2(f.l(2), f.l(1), 0.0);
    plane.first = first;
    first += plane.count;
    tied.planes.push_back(plane);
    of.push_back(p);
  }
  tied.shares.resize(static_cast<std::size_t>(first));
  ParallelChunks(of.size(), kChunk, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const TiedPlane& plane = tied.planes[i];
      const Plane& from = problem.planes[of[i]];
      PlaneShare* to = tied.shares.data() + plane.first;
      ForEachShare(problem, from, group_of, fixed_group, [&](int group, const PlaneObservation* o) {
        if (o == nullptr) {
          *to++ = {group, Moments(plane, from.fixed), plane.mean};
          return;
        }
        const auto k = static_cast<std::size_t>(o->frame);
        const PointCluster moved = o->cluster.Moved(poses.R[k], poses.t[k]);
        *to++ = {group, Moments(plane, moved), poses.t[k]};
      });
    }
  });
  return tied;
}

TiedPlanes MergeGroups(const TiedPlanes& tied, const std::vector<int>& into) {
  TiedPlanes merged;
  std::vector<PlaneShare> shares;
  std::vector<std::size_t> place(into.size());  // of each group in `shares`, if it is there
  for (const TiedPlane& plane : tied.planes) {
    shares.clear();
    for (std::int32_t s = plane.first; s < plane.first + plane.count; ++s) {
      PlaneShare share = tied.shares[static_cast<std::size_t>(s)];
      share.group = into[static_cast<std::size_t>(share.group)];
      std::size_t& at = place[static_cast<std::size_t>(share.group)];
      if (at < shares.size() && shares[at].group == share.group) {
        Add(share, &shares[at]);
      } else {
        at = shares.size();
        shares.push_back(share);
      }
    }
    Append(plane, shares, &merged);
  }
  return merged;
}

Eigen::Matrix3d InverseMoments(const Eigen::Matrix3d& F) {
  constexpr double kNoExtent = 1e-12;  // m^2; of the number of points, too
  Eigen::Matrix3d sum = F;
  sum.diagonal().array() += kNoExtent * F(0, 0) + 1e-300;
  return sum.inverse();
}

Vector6d HeldRow(const SE3& T, const Vector6d& direction, const Eigen::Vector3d& c) {
  const Eigen::Vector3d along = direction.tail<3>();
  Vector6d row;
  row << (T.q * direction.head<3>() + (T.t - c).cross(along)) / kRotationArmM, along;
  return row;
}

}  // namespace lamina
