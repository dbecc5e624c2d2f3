#include "backend/bundle/uncertainty/rigid_groups.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <numeric>
#include <queue>
#include <utility>

#include "core/geometry/degeneracy.h"

namespace lamina {
namespace {

// Fewer planes cannot determine six directions.
constexpr int kLeastPlanes = 3;

// A plane between two groups: F_1 (F_1 + F_2)^-1 F_2, and where it was seen from.
struct Link {
  const TiedPlane* plane;
  Eigen::Matrix3d F;
  Eigen::Vector3d origin;
};

// Whether these links and holds determine all six directions.
bool Determined(const std::vector<Link>& links, const std::vector<HeldDirection>& holds,
                const std::vector<SE3>& poses, double max_sigma_m) {
  double points = 0.0;
  Eigen::Vector3d c = Eigen::Vector3d::Zero();
  for (const Link& link : links) {
    points += link.F(0, 0);
    if (link.F(0, 0) > 0.0) c += (link.F(0, 0) / points) * (link.origin - c);
  }
  Matrix6d H = Matrix6d::Zero();
  for (const Link& link : links) {
    const Eigen::Matrix<double, 3, 6> A = link.plane->NormalMotion(c);
    H.noalias() += A.transpose() * (link.plane->weight * link.F * A);
  }
  std::vector<Vector6d> rows;
  for (const HeldDirection& hold : holds) {
    rows.push_back(HeldRow(poses[static_cast<std::size_t>(hold.frame)], hold.direction, c));
    H += kHeldInformation * rows.back() * rows.back().transpose();
  }
  const Matrix6d directions = Eigen::SelfAdjointEigenSolver<Matrix6d>(H).eigenvectors();
  for (int i = 0; i < 6; ++i) {
    const Vector6d v = directions.col(i);
    double information = 0.0;
    for (const Vector6d& row : rows) information += kHeldInformation * std::pow(row.dot(v), 2);
    for (const Link& link : links) {
      if (information * max_sigma_m * max_sigma_m >= 1.0) break;
      const Eigen::Matrix3d Y = link.plane->Motion(c, v);
      information += link.plane->Information((Y.transpose() * link.F * Y).diagonal());
    }
    if (information * max_sigma_m * max_sigma_m < 1.0) return false;
  }
  return true;
}

// One repetition: regions of groups, each grown from a seed.
class RegionGrowing {
 public:
  RegionGrowing(const std::vector<SE3>& poses, const RigidGroups& rigid, double max_sigma_m)
      : poses_(poses),
        rigid_(rigid),
        max_sigma_m_(max_sigma_m),
        into_(rigid.groups.size(), -1),
        region_(rigid.tied.planes.size()),
        first_(rigid.groups.size() + 1, 0),
        neighbours_(rigid.groups.size()) {
    for (const PlaneShare& share : rigid.tied.shares) ++first_[Index(share.group) + 1];
    std::partial_sum(first_.begin(), first_.end(), first_.begin());
    shares_of_.resize(rigid.tied.shares.size());
    std::vector<std::size_t> next = first_;
    for (std::size_t p = 0; p < rigid.tied.planes.size(); ++p) {
      const TiedPlane& plane = rigid.tied.planes[p];
      for (std::int32_t s = plane.first; s < plane.first + plane.count; ++s) {
        shares_of_[next[Index(rigid.tied.shares[Index(s)].group)]++] = {p, Index(s)};
      }
    }
  }

  // The group that each one joins: itself, or the seed of its region.
  std::vector<int> Grow() {
    for (const int seed : Seeds()) {
      if (into_[Index(seed)] < 0) GrowFrom(seed);
    }
    return into_;
  }

 private:
  struct PlaneAndShare {
    std::size_t plane, share;
  };
  // What the present region knows of a plane.
  struct Known {
    int seed = -1;
    Eigen::Matrix3d F;
  };
  // A group beside the present region.
  struct Neighbour {
    int seed = -1;
    int planes = 0, failed_at = 0;  // shared with the region: now, and when it did not join
    bool queued = false;
  };

  static std::size_t Index(int i) { return static_cast<std::size_t>(i); }

  // What stands, then what is free in itself, large ones first; what is held in part comes last,
  // since it joins the others but they cannot join it.
  std::vector<int> Seeds() const {
    std::vector<int> seeds(rigid_.groups.size());
    std::iota(seeds.begin(), seeds.end(), 0);
    std::stable_sort(seeds.begin(), seeds.end(), [&](int a, int b) {
      const FrameGroup &A = rigid_.groups[Index(a)], &B = rigid_.groups[Index(b)];
      if (A.stands != B.stands) return A.stands;
      if (A.holds.empty() != B.holds.empty()) return A.holds.empty();
      return A.frames.size() > B.frames.size();
    });
    return seeds;
  }

  void GrowFrom(int seed) {
    queue_ = {};
    Take(seed, seed);
    while (!queue_.empty()) {
      const auto [planes, minus_group] = queue_.top();
      queue_.pop();
      const int group = -minus_group;
      Neighbour& neighbour = neighbours_[Index(group)];
      if (neighbour.planes > planes) {  // has more by now: to its place
        queue_.emplace(neighbour.planes, minus_group);
        continue;
      }
      neighbour.queued = false;
      if (Joins(group, seed)) {
        Take(group, seed);
      } else {
        neighbour.failed_at = neighbour.planes;
      }
    }
  }

  void Take(int group, int seed) {
    into_[Index(group)] = seed;
    for (std::size_t i = first_[Index(group)]; i < first_[Index(group) + 1]; ++i) {
      const TiedPlane& plane = rigid_.tied.planes[shares_of_[i].plane];
      const PlaneShare& share = rigid_.tied.shares[shares_of_[i].share];
      Known& known = region_[shares_of_[i].plane];
      if (std::exchange(known.seed, seed) == seed) {
        known.F += share.F();
        continue;
      }
      known.F = share.F();
      for (std::int32_t s = plane.first; s < plane.first + plane.count; ++s) {
        CountPlane(rigid_.tied.shares[Index(s)].group, seed);
      }
    }
  }

  void CountPlane(int group, int seed) {
    if (into_[Index(group)] >= 0) return;
    Neighbour& neighbour = neighbours_[Index(group)];
    if (neighbour.seed != seed) neighbour = {seed};
    ++neighbour.planes;
    // One that did not join is tried again when it shares half as many more.
    if (neighbour.queued || neighbour.planes < kLeastPlanes ||
        2 * neighbour.planes < 3 * neighbour.failed_at) {
      return;
    }
    neighbour.queued = true;
    queue_.emplace(neighbour.planes, -group);
  }

  bool Joins(int group, int seed) const {
    const FrameGroup& candidate = rigid_.groups[Index(group)];
    std::vector<Link> links;
    // Few planes are enough where there are many, and more can only add to them.
    std::size_t enough = 48;
    for (std::size_t i = first_[Index(group)]; i < first_[Index(group) + 1]; ++i) {
      const Known& known = region_[shares_of_[i].plane];
      if (known.seed != seed) continue;
      const PlaneShare& share = rigid_.tied.shares[shares_of_[i].share];
      const Eigen::Matrix3d F = share.F() * InverseMoments(share.F() + known.F) * known.F;
      links.push_back(
          {&rigid_.tied.planes[shares_of_[i].plane], 0.5 * (F + F.transpose()), share.origin});
      if (links.size() != enough) continue;
      if (Determined(links, candidate.holds, poses_, max_sigma_m_)) return true;
      enough *= 4;
    }
    return Determined(links, candidate.holds, poses_, max_sigma_m_);
  }

  const std::vector<SE3>& poses_;
  const RigidGroups& rigid_;
  const double max_sigma_m_;
  std::vector<int> into_;
  std::vector<Known> region_;             // of each plane
  std::vector<std::size_t> first_;        // of each group, in shares_of_; one more at the end
  std::vector<PlaneAndShare> shares_of_;  // by group
  std::vector<Neighbour> neighbours_;     // of each group
  std::priority_queue<std::pair<int, int>> queue_;  // planes shared, -group
};

}  // namespace

void JoinGroups(const std::vector<int>& into, RigidGroups* rigid) {
  for (std::size_t g = 0; g < into.size(); ++g) {
    if (into[g] == static_cast<int>(g)) continue;
    FrameGroup& from = rigid->groups[g];
    FrameGroup& to = rigid->groups[static_cast<std::size_t>(into[g])];
    if (from.frames.empty()) continue;
    to.frames.insert(to.frames.end(), from.frames.begin(), from.frames.end());
    if (from.holds.empty()) to.holds.clear();
    if (!to.holds.empty()) {
      to.holds.insert(to.holds.end(), from.holds.begin(), from.holds.end());
    }
    from = FrameGroup();
  }
  for (FrameGroup& group : rigid->groups) std::sort(group.frames.begin(), group.frames.end());
  rigid->tied = MergeGroups(rigid->tied, into);
}

void JoinRigidGroups(const std::vector<SE3>& poses, double max_sigma_m, RigidGroups* rigid) {
  bool joined = true;
  while (joined && !rigid->tied.planes.empty()) {
    const std::vector<int> into = RegionGrowing(poses, *rigid, max_sigma_m).Grow();
    joined = false;
    for (std::size_t g = 0; g < into.size(); ++g) joined |= into[g] != static_cast<int>(g);
    if (joined) JoinGroups(into, rigid);
  }
}

RigidGroups FindRigidGroups(const BundleProblem& problem, const std::vector<PlaneFrame>& frames,
                            const std::vector<bool>& usable,
                            const std::vector<std::vector<HeldDirection>>& open,
                            double max_sigma_m) {
  RigidGroups rigid;
  rigid.groups.resize(usable.size() + 1);
  std::vector<int> group_of(usable.size(), -1);
  for (std::size_t k = 0; k < usable.size(); ++k) {
    if (!usable[k]) continue;
    group_of[k] = static_cast<int>(k);
    rigid.groups[k].frames = {static_cast<int>(k)};
    rigid.groups[k].holds = open[k];
  }
  const auto fixed = static_cast<int>(usable.size());
  rigid.tied = TiePlanes(problem, frames, group_of, fixed);
  rigid.groups.back().stands = std::any_of(problem.planes.begin(), problem.planes.end(),
                                           [](const Plane& plane) { return !plane.fixed.Empty(); });
  JoinRigidGroups(problem.poses, max_sigma_m, &rigid);
  return rigid;
}

}  // namespace lamina
