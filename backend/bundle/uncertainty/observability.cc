#include "backend/bundle/uncertainty/observability.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <iomanip>
#include <limits>
#include <map>
#include <sstream>

#include "backend/bundle/plane_geometry.h"
#include "backend/bundle/uncertainty/sliding_groups.h"
#include "core/base/disjoint_sets.h"
#include "core/geometry/degeneracy.h"

namespace lamina {
namespace {

bool IsShared(const Plane& plane) { return plane.count >= 2 || !plane.fixed.Empty(); }

// Residual rows of one observation, scaled to metres, and how much an error of the normal by one
// radian turns each, relative to (rotation, translation).
struct ScaledRows {
  Eigen::Matrix<double, 3, 6> rows;
  Eigen::Vector3d rotation_arm, translation_arm;
};

ScaledRows RowsOf(const PlaneObservation& o, const SE3& T, const Eigen::Vector3d& normal) {
  const Eigen::Vector3d m = T.q.conjugate() * normal;
  const Eigen3 eigen = o.cluster.EigenPairs();
  const double root = std::sqrt(o.cluster.count);
  ScaledRows s;
  s.rows.row(0) << root * o.cluster.mean.cross(m).transpose() / kRotationArmM,
      root * normal.transpose();
  s.rotation_arm(0) = root * o.cluster.mean.norm() / kRotationArmM;
  s.translation_arm(0) = root;
  for (int k = 0; k < 2; ++k) {
    const Eigen::Vector3d axis = root * std::sqrt(std::max(0.0, eigen.l(k))) * eigen.u.col(k);
    s.rows.row(k + 1) << axis.cross(m).transpose() / kRotationArmM, 0.0, 0.0, 0.0;
    s.rotation_arm(k + 1) = axis.norm() / kRotationArmM;
    s.translation_arm(k + 1) = 0.0;
  }
  return s;
}

// Calls visit(frame, rows, plane's weight, squared error of its normal) for each observation of a
// shared plane.
template <typename Visit>
void ForEachRows(const BundleProblem& problem, const std::vector<PlaneFrame>& planes,
                 const Visit& visit) {
  for (std::size_t p = 0; p < planes.size(); ++p) {
    const Plane& plane = problem.planes[p];
    if (!IsShared(plane)) continue;
    const Eigen::Vector3d& l = planes[p].l;
    const double normal_error2 = NormalError2(l(2), l(1), 0.0);
    for (int i = plane.first; i < plane.first + plane.count; ++i) {
      const PlaneObservation& o = problem.observations[static_cast<std::size_t>(i)];
      const auto k = static_cast<std::size_t>(o.frame);
      visit(k, RowsOf(o, problem.poses[k], planes[p].normal), plane.weight, normal_error2);
    }
  }
}

// What is known of each frame along the eigenvectors of its own information.
std::vector<DirectionEvidence> FrameEvidence(const BundleProblem& problem,
                                             const std::vector<PlaneFrame>& planes) {
  std::vector<Matrix6d> H(problem.poses.size(), Matrix6d::Zero());
  ForEachRows(problem, planes, [&](std::size_t k, const ScaledRows& s, double weight, double) {
    H[k] += weight * s.rows.transpose() * s.rows;
  });
  std::vector<DirectionEvidence> evidence(H.size());
  for (std::size_t k = 0; k < H.size(); ++k) {
    evidence[k].directions = Eigen::SelfAdjointEigenSolver<Matrix6d>(H[k]).eigenvectors();
  }
  ForEachRows(problem, planes,
              [&](std::size_t k, const ScaledRows& s, double weight, double normal_error2) {
                for (int r = 0; r < 3; ++r) {
                  evidence[k].Add(s.rows.row(r).transpose(), weight, normal_error2,
                                  s.rotation_arm(r), s.translation_arm(r));
                }
              });
  return evidence;
}

std::vector<BundleFault> OpenDirections(int frame, const DirectionEvidence& evidence,
                                        double max_sigma_m) {
  std::vector<BundleFault> faults;
  for (int i = 0; i < 6; ++i) {
    if (evidence.Sigma(i) <= max_sigma_m) continue;
    BundleFault fault;
    fault.kind = BundleFault::Kind::kOpenDirection;
    fault.frame = frame;
    fault.sigma_m = evidence.Sigma(i);
    fault.direction = DividedByArm(Vector6d(evidence.directions.col(i))).normalized();
    faults.push_back(fault);
  }
  return faults;
}

void HoldAll(int frame, std::vector<HeldDirection>* holds) {
  for (int i = 0; i < 6; ++i) holds->push_back({frame, Vector6d::Unit(i)});
}

std::vector<int> SharedPlanes(const BundleProblem& problem) {
  std::vector<int> shared(problem.poses.size(), 0);
  for (const Plane& plane : problem.planes) {
    if (!IsShared(plane)) continue;
    for (int i = plane.first; i < plane.first + plane.count; ++i) {
      ++shared[static_cast<std::size_t>(problem.observations[static_cast<std::size_t>(i)].frame)];
    }
  }
  return shared;
}

// Members of each group, by its leading frame; frames that share too little are left out.
std::map<int, std::vector<int>> FindGroups(const BundleProblem& problem,
                                           const std::vector<bool>& usable) {
  DisjointSets groups(problem.poses.size());
  for (const Plane& plane : problem.planes) {
    int joined = -1;
    for (int i = plane.first; i < plane.first + plane.count; ++i) {
      const int frame = problem.observations[static_cast<std::size_t>(i)].frame;
      if (!usable[static_cast<std::size_t>(frame)]) continue;
      if (joined >= 0)
        groups.Join(static_cast<std::size_t>(joined), static_cast<std::size_t>(frame));
      joined = frame;
    }
  }
  std::map<int, std::vector<int>> members;
  for (std::size_t k = 0; k < usable.size(); ++k) {
    if (usable[k]) members[static_cast<int>(groups.Find(k))].push_back(static_cast<int>(k));
  }
  return members;
}

bool HasFixedPlanes(const BundleProblem& problem) {
  return std::any_of(problem.planes.begin(), problem.planes.end(),
                     [](const Plane& p) { return !p.fixed.Empty(); });
}

using HoldsOfFrames = std::vector<std::vector<HeldDirection>>;

// Holds one frame of each group, and reports all groups but the largest. It is the first of the
// largest rigid group within; if it can be, one whose planes determine it, since one with an open
// direction would leave the others free along it.
void HoldGauge(const std::map<int, std::vector<int>>& groups, const HoldsOfFrames& open,
               RigidGroups* rigid, Observability* result) {
  std::vector<std::size_t> rigid_of(open.size());
  for (std::size_t g = 0; g < rigid->groups.size(); ++g) {
    for (const int frame : rigid->groups[g].frames) rigid_of[static_cast<std::size_t>(frame)] = g;
  }
  const auto largest = std::max_element(
      groups.begin(), groups.end(),
      [](const auto& a, const auto& b) { return a.second.size() < b.second.size(); });
  for (auto group = groups.begin(); group != groups.end(); ++group) {
    const auto size_of = [&](int frame) {
      return rigid->groups[rigid_of[static_cast<std::size_t>(frame)]].frames.size();
    };
    const int in_largest = *std::max_element(group->second.begin(), group->second.end(),
                                             [&](int a, int b) { return size_of(a) < size_of(b); });
    FrameGroup& standing = rigid->groups[rigid_of[static_cast<std::size_t>(in_largest)]];
    standing.stands = true;
    const auto gauge = std::find_if(standing.frames.begin(), standing.frames.end(), [&](int frame) {
      return open[static_cast<std::size_t>(frame)].empty();
    });
    HoldAll(gauge == standing.frames.end() ? standing.frames.front() : *gauge, &result->holds);
    if (group == largest) continue;
    BundleFault fault;
    fault.kind = BundleFault::Kind::kApart;
    fault.frame = group->first;
    fault.group = group->second;
    result->faults.push_back(fault);
  }
}

// The open directions of single frames. The gauge is held already.
void HoldOpenDirections(const std::vector<std::vector<BundleFault>>& open, Observability* result) {
  std::vector<bool> gauge(open.size(), false);
  for (const HeldDirection& hold : result->holds) {
    gauge[static_cast<std::size_t>(hold.frame)] = true;
  }
  for (std::size_t k = 0; k < open.size(); ++k) {
    if (gauge[k]) continue;
    for (const BundleFault& fault : open[k]) {
      result->holds.push_back({fault.frame, fault.direction});
      result->faults.push_back(fault);
    }
  }
}

void HoldSlides(const std::vector<GroupSlide>& slides, Observability* result) {
  for (const GroupSlide& slide : slides) {
    BundleFault fault;
    fault.kind = BundleFault::Kind::kOpenDirection;
    fault.frame = slide.hold.frame;
    fault.group = slide.frames;
    fault.direction = slide.twist;
    fault.motion = slide.motion;
    fault.sigma_m = slide.sigma_m;
    result->faults.push_back(fault);
    result->holds.push_back(slide.hold);
  }
}

// Frames in ascending order, runs of them by their ends: 1, 3 to 7.
std::string ListOfFrames(const std::vector<int>& frames) {
  std::ostringstream text;
  text << (frames.size() == 1 ? "frame " : "frames ");
  for (std::size_t i = 0; i < frames.size(); ++i) {
    std::size_t end = i;
    while (end + 1 < frames.size() && frames[end + 1] == frames[end] + 1) ++end;
    text << (i > 0 ? ", " : "") << frames[i];
    if (end < i + 2) continue;
    text << " to " << frames[end];
    i = end;
  }
  return text.str();
}

}  // namespace

void ObservabilityOptions::Visit(OptionVisitor& v) {
  v.Integer("min_shared_planes", &min_shared_planes, 1, 1000000);
  v.Number("max_direction_sigma_m", &max_direction_sigma_m, 1e-6, 1e6);
}

std::string BundleFault::Describe() const {
  std::ostringstream text;
  text << std::setprecision(2);
  switch (kind) {
    case Kind::kTooFewPlanes:
      text << "frame " << frame << " shares " << shared_planes
           << " planes with other frames, too few to hold it";
      break;
    case Kind::kApart:
      text << ListOfFrames(group);
      text << (group.size() == 1 ? " shares" : " share") << " no plane with the other frames";
      break;
    case Kind::kLeapt:
      text << "frame " << frame
           << " would have been carried farther than a voxel; it kept its pose in the last round";
      break;
    case Kind::kOpenDirection: {
      const bool turn = direction.head<3>().norm() * kRotationArmM > direction.tail<3>().norm();
      const Eigen::Vector3d axis = (turn ? direction.head<3>() : direction.tail<3>()).normalized();
      text << (group.empty() ? "frame " + std::to_string(frame) : ListOfFrames(group))
           << ": no plane holds " << (group.size() > 1 ? "their common " : "its ")
           << (!turn           ? "motion along the world's direction"
               : group.empty() ? "turn about the LiDAR's axis"
                               : "turn about the world's axis")
           << " (" << axis.x() << ", " << axis.y() << ", " << axis.z() << ")";
      if (std::isfinite(sigma_m)) text << ", known to " << sigma_m << " m";
      break;
    }
  }
  return text.str();
}

Observability FindObservability(const BundleProblem& problem, const ObservabilityOptions& options,
                                Slides slides) {
  CheckOptions(options, "registration.observability");
  Observability result;
  const std::vector<int> shared = SharedPlanes(problem);
  std::vector<bool> usable(shared.size());
  for (std::size_t k = 0; k < shared.size(); ++k) {
    usable[k] = shared[k] >= options.min_shared_planes;
    if (usable[k]) continue;
    BundleFault fault;
    fault.frame = static_cast<int>(k);
    fault.shared_planes = shared[k];
    result.faults.push_back(fault);
    HoldAll(fault.frame, &result.holds);
  }
  const std::vector<PlaneFrame> planes = MakePlaneFrames(problem, PoseMatrices(problem.poses));
  const std::vector<DirectionEvidence> frames = FrameEvidence(problem, planes);
  std::vector<std::vector<BundleFault>> open(shared.size());
  HoldsOfFrames open_holds(shared.size());
  for (std::size_t k = 0; k < shared.size(); ++k) {
    if (!usable[k]) continue;
    open[k] = OpenDirections(static_cast<int>(k), frames[k], options.max_direction_sigma_m);
    for (const BundleFault& fault : open[k]) {
      open_holds[k].push_back({fault.frame, fault.direction});
    }
  }
  RigidGroups rigid =
      FindRigidGroups(problem, planes, usable, open_holds, options.max_direction_sigma_m);
  // Fixed clusters hold the gauge of all that stands on them.
  if (!HasFixedPlanes(problem)) {
    HoldGauge(FindGroups(problem, usable), open_holds, &rigid, &result);
  }
  HoldOpenDirections(open, &result);
  if (slides == Slides::kHeld) {
    HoldSlides(FindSlides(problem.poses, open_holds, options.max_direction_sigma_m, &rigid),
               &result);
  }
  std::vector<int> held(shared.size(), 0);
  for (const HeldDirection& hold : result.holds) ++held[static_cast<std::size_t>(hold.frame)];
  for (std::size_t k = 0; k < held.size(); ++k) {
    if (held[k] < 6) result.free_frames.push_back(static_cast<int>(k));
  }
  return result;
}

}  // namespace lamina
