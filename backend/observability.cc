#include "backend/observability.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <iomanip>
#include <limits>
#include <map>
#include <numeric>
#include <sstream>

#include "backend/frame_pass.h"
#include "frontend/degeneracy.h"

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
  const Eigen3 eigen = o.cluster.Eigen();
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
std::vector<DirectionEvidence> FrameEvidence(const BundleProblem& problem) {
  const std::vector<PlaneFrame> planes = MakePlaneFrames(problem, PoseMatrices(problem.poses));
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

// Frames joined by planes that they share.
class Groups {
 public:
  explicit Groups(std::size_t frames) : parent_(frames) {
    std::iota(parent_.begin(), parent_.end(), 0);
  }
  int Find(int a) {
    while (parent_[static_cast<std::size_t>(a)] != a) {
      int& up = parent_[static_cast<std::size_t>(a)];
      up = parent_[static_cast<std::size_t>(up)];
      a = up;
    }
    return a;
  }
  // The smaller number leads.
  void Join(int a, int b) {
    a = Find(a);
    b = Find(b);
    parent_[static_cast<std::size_t>(std::max(a, b))] = std::min(a, b);
  }

 private:
  std::vector<int> parent_;
};

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
  Groups groups(problem.poses.size());
  for (const Plane& plane : problem.planes) {
    int joined = -1;
    for (int i = plane.first; i < plane.first + plane.count; ++i) {
      const int frame = problem.observations[static_cast<std::size_t>(i)].frame;
      if (!usable[static_cast<std::size_t>(frame)]) continue;
      if (joined >= 0) groups.Join(joined, frame);
      joined = frame;
    }
  }
  std::map<int, std::vector<int>> members;
  for (std::size_t k = 0; k < usable.size(); ++k) {
    if (usable[k]) members[groups.Find(static_cast<int>(k))].push_back(static_cast<int>(k));
  }
  return members;
}

bool HasFixedPlanes(const BundleProblem& problem) {
  return std::any_of(problem.planes.begin(), problem.planes.end(),
                     [](const Plane& p) { return !p.fixed.Empty(); });
}

// Holds the first frame of each group, and reports all groups but the largest.
void HoldGauge(const std::map<int, std::vector<int>>& groups, Observability* result) {
  const auto largest = std::max_element(
      groups.begin(), groups.end(),
      [](const auto& a, const auto& b) { return a.second.size() < b.second.size(); });
  for (auto group = groups.begin(); group != groups.end(); ++group) {
    HoldAll(group->first, &result->holds);
    if (group == largest) continue;
    BundleFault fault;
    fault.kind = BundleFault::Kind::kApart;
    fault.frame = group->first;
    fault.group = group->second;
    result->faults.push_back(fault);
  }
}

void FindOpenDirections(const BundleProblem& problem, const ObservabilityOptions& options,
                        const std::vector<bool>& usable, Observability* result) {
  const std::vector<DirectionEvidence> frames = FrameEvidence(problem);
  std::vector<bool> gauge(problem.poses.size(), false);
  for (const HeldDirection& hold : result->holds)
    gauge[static_cast<std::size_t>(hold.frame)] = true;
  for (std::size_t k = 0; k < frames.size(); ++k) {
    if (!usable[k] || gauge[k]) continue;
    const std::vector<BundleFault> open =
        OpenDirections(static_cast<int>(k), frames[k], options.max_direction_sigma_m);
    for (const BundleFault& fault : open) {
      result->holds.push_back({fault.frame, fault.direction});
      result->faults.push_back(fault);
    }
    if (open.size() < 6) result->free_frames.push_back(static_cast<int>(k));
  }
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
      text << (group.size() == 1 ? "frame " : "frames ");
      for (std::size_t i = 0; i < group.size(); ++i) text << (i > 0 ? ", " : "") << group[i];
      text << (group.size() == 1 ? " shares" : " share") << " no plane with the other frames";
      break;
    case Kind::kLeapt:
      text << "frame " << frame
           << " would have been carried farther than a voxel; it kept its pose in the last round";
      break;
    case Kind::kOpenDirection: {
      const bool turn = direction.head<3>().norm() * kRotationArmM > direction.tail<3>().norm();
      const Eigen::Vector3d axis = (turn ? direction.head<3>() : direction.tail<3>()).normalized();
      text << "frame " << frame << ": no plane holds its "
           << (turn ? "turn about the LiDAR's axis" : "motion along the world's direction") << " ("
           << axis.x() << ", " << axis.y() << ", " << axis.z() << ")";
      if (std::isfinite(sigma_m)) text << ", known to " << sigma_m << " m";
      break;
    }
  }
  return text.str();
}

Observability FindObservability(const BundleProblem& problem, const ObservabilityOptions& options) {
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
  // Fixed clusters hold the gauge, and join whatever stands on them.
  if (!HasFixedPlanes(problem)) HoldGauge(FindGroups(problem, usable), &result);
  FindOpenDirections(problem, options, usable, &result);
  return result;
}

}  // namespace lamina
