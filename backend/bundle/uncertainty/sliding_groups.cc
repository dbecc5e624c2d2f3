#include "backend/bundle/uncertainty/sliding_groups.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <utility>

#include "core/geometry/degeneracy.h"

namespace lamina {
namespace {

// So many groups are looked at together; more of them, which are smaller, stand meanwhile.
constexpr std::size_t kMostTogether = 64;

// How a frame at T moves by a scaled twist about c.
Vector6d Tangent(const SE3& T, const Eigen::Vector3d& c, const Vector6d& twist) {
  const Vector6d motion = DividedByArm(twist);
  const Eigen::Vector3d w = motion.head<3>();
  Vector6d tangent;
  tangent << T.q.conjugate() * w, motion.tail<3>() + w.cross(T.t - c);
  return tangent;
}

// Groups that do not stand, from the largest to the smallest.
std::vector<int> MovingGroups(const RigidGroups& rigid) {
  std::vector<int> moving;
  for (std::size_t g = 0; g < rigid.groups.size(); ++g) {
    const FrameGroup& group = rigid.groups[g];
    if (!group.stands && !group.frames.empty()) moving.push_back(static_cast<int>(g));
  }
  std::stable_sort(moving.begin(), moving.end(), [&](int a, int b) {
    return rigid.groups[static_cast<std::size_t>(a)].frames.size() >
           rigid.groups[static_cast<std::size_t>(b)].frames.size();
  });
  return moving;
}

class JointMotion {
 public:
  JointMotion(const std::vector<SE3>& poses, const std::vector<std::vector<HeldDirection>>& open,
              const RigidGroups& rigid, const std::vector<int>& moving, double max_sigma_m)
      : poses_(poses),
        rigid_(rigid),
        moving_(moving),
        max_sigma_m_(max_sigma_m),
        number_of_(rigid.groups.size(), -1),
        held_frame_(moving.size(), 0),
        centres_(moving.size(), Eigen::Vector3d::Zero()),
        holds_(moving.size()),
        inverse_(moving.size(), Matrix6d::Zero()) {
    for (std::size_t i = 0; i < moving.size(); ++i) number_of_[At(moving[i])] = static_cast<int>(i);
    FindCentres(open);
    Assemble();
  }

  std::vector<GroupSlide> FindOpen() {
    std::vector<GroupSlide> slides;
    for (std::size_t i = moving_.size(); i-- > 0;) Eliminate(i, &slides);
    return slides;
  }

 private:
  static std::size_t At(int i) { return static_cast<std::size_t>(i); }
  static Eigen::Index Row(std::size_t i) { return static_cast<Eigen::Index>(6 * i); }

  // Number of a share's group among the moving ones; negative if it stands.
  int NumberOf(const PlaneShare& share) const { return number_of_[At(share.group)]; }

  // Calls visit(plane, begin and end of its shares, sum of their F) where something moves.
  template <typename Visit>
  void ForEachPlane(const Visit& visit) const {
    for (const TiedPlane& plane : rigid_.tied.planes) {
      const PlaneShare* begin = rigid_.tied.shares.data() + plane.first;
      const PlaneShare* end = begin + plane.count;
      if (std::none_of(begin, end, [&](const PlaneShare& s) { return NumberOf(s) >= 0; })) continue;
      Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
      for (const PlaneShare* s = begin; s != end; ++s) sum += s->F();
      visit(plane, begin, end, sum);
    }
  }

  // Of each group, where it saw from what it shares, and its first frame: one that has held
  // directions of its own cannot hold the group along them.
  void FindCentres(const std::vector<std::vector<HeldDirection>>& open) {
    std::vector<double> points(moving_.size(), 0.0);
    ForEachPlane([&](const TiedPlane&, const PlaneShare* begin, const PlaneShare* end,
                     const Eigen::Matrix3d& sum) {
      for (const PlaneShare* s = begin; s != end; ++s) {
        if (NumberOf(*s) < 0 || !(sum(0, 0) > 0.0)) continue;
        const std::size_t i = At(NumberOf(*s));
        const double n = s->moments.xx * (1.0 - s->moments.xx / sum(0, 0));
        points[i] += n;
        if (n > 0.0) centres_[i] += (n / points[i]) * (s->origin - centres_[i]);
      }
    });
    for (std::size_t i = 0; i < moving_.size(); ++i) {
      const FrameGroup& group = rigid_.groups[At(moving_[i])];
      const auto first = std::find_if(group.frames.begin(), group.frames.end(),
                                      [&](int frame) { return open[At(frame)].empty(); });
      held_frame_[i] = first == group.frames.end() ? group.frames.front() : *first;
      for (const HeldDirection& hold : group.holds) {
        holds_[i].push_back(HeldRow(poses_[At(hold.frame)], hold.direction, centres_[i]));
      }
    }
  }

  void Assemble() {
    const auto size = Row(moving_.size());
    H_.setZero(size, size);
    ForEachPlane([&](const TiedPlane& plane, const PlaneShare* begin, const PlaneShare* end,
                     const Eigen::Matrix3d& sum) {
      const Eigen::Matrix3d T = InverseMoments(sum);
      for (const PlaneShare* g = begin; g != end; ++g) {
        if (NumberOf(*g) < 0) continue;
        const std::size_t i = At(NumberOf(*g));
        const Eigen::Matrix<double, 6, 3> left =
            plane.weight * plane.NormalMotion(centres_[i]).transpose() * g->F() * T;
        for (const PlaneShare* h = begin; h != end; ++h) {
          if (NumberOf(*h) < 0) continue;
          const std::size_t k = At(NumberOf(*h));
          const Eigen::Matrix3d F =
              g == h ? Eigen::Matrix3d(sum - g->F()) : Eigen::Matrix3d(-h->F());
          H_.block<6, 6>(Row(i), Row(k)) += left * F * plane.NormalMotion(centres_[k]);
        }
      }
    });
    for (std::size_t i = 0; i < moving_.size(); ++i) {
      for (const Vector6d& row : holds_[i]) {
        H_.block<6, 6>(Row(i), Row(i)) += kHeldInformation * row * row.transpose();
      }
    }
  }

  // Finds what is open of group i, and takes the group out of what is before it.
  void Eliminate(std::size_t i, std::vector<GroupSlide>* slides) {
    const Matrix6d P = H_.block<6, 6>(Row(i), Row(i));
    const Eigen::SelfAdjointEigenSolver<Matrix6d> eigen(Matrix6d(0.5 * (P + P.transpose())));
    for (int k = 0; k < 6; ++k) {
      const Vector6d v = eigen.eigenvectors().col(k);
      const std::vector<Vector6d> motion = MotionWithFollowers(i, v);
      const double information = Information(motion);
      if (information * max_sigma_m_ * max_sigma_m_ >= 1.0) {
        // What counts of the information is never more than its whole.
        inverse_[i] += v * v.transpose() / std::max(eigen.eigenvalues()(k), information);
      } else {
        slides->push_back(Slide(i, motion, information));
      }
    }
    const Eigen::Index rest = Row(i);
    const Eigen::MatrixXd rows = H_.block(Row(i), 0, 6, rest);
    H_.topLeftCorner(rest, rest) -= rows.transpose() * inverse_[i] * rows;
  }

  // Scaled twists of all moving groups: i by v, those before it not at all, those after it so that
  // they follow.
  std::vector<Vector6d> MotionWithFollowers(std::size_t i, const Vector6d& v) const {
    std::vector<Vector6d> motion(moving_.size(), Vector6d::Zero());
    motion[i] = v;
    for (std::size_t f = i + 1; f < moving_.size(); ++f) {
      Vector6d pull = Vector6d::Zero();
      for (std::size_t k = i; k < f; ++k) pull += H_.block<6, 6>(Row(f), Row(k)) * motion[k];
      motion[f] = -inverse_[f] * pull;
    }
    return motion;
  }

  double Information(const std::vector<Vector6d>& motion) const {
    double information = 0.0;
    for (std::size_t i = 0; i < motion.size(); ++i) {
      for (const Vector6d& row : holds_[i]) {
        information += kHeldInformation * std::pow(row.dot(motion[i]), 2);
      }
    }
    std::vector<Eigen::Matrix3d> moved;
    ForEachPlane([&](const TiedPlane& plane, const PlaneShare* begin, const PlaneShare* end,
                     const Eigen::Matrix3d& sum) {
      moved.clear();
      Eigen::Matrix3d total = Eigen::Matrix3d::Zero();
      for (const PlaneShare* s = begin; s != end; ++s) {
        const int i = NumberOf(*s);
        moved.push_back(i < 0 ? Eigen::Matrix3d::Zero().eval()
                              : plane.Motion(centres_[At(i)], motion[At(i)]));
        total += s->F() * moved.back();
      }
      const Eigen::Matrix3d mean = InverseMoments(sum) * total;
      Eigen::Vector3d E = Eigen::Vector3d::Zero();
      for (const PlaneShare* s = begin; s != end; ++s) {
        const Eigen::Matrix3d Y = moved[static_cast<std::size_t>(s - begin)] - mean;
        E += (Y.transpose() * s->F() * Y).diagonal();
      }
      information += plane.Information(E);
    });
    return information;
  }

  GroupSlide Slide(std::size_t i, const std::vector<Vector6d>& motion, double information) const {
    constexpr double kTakesPart = 0.1;  // of the motion of group i
    const SE3& held = poses_[At(held_frame_[i])];
    const Vector6d tangent = Tangent(held, centres_[i], motion[i]);
    const double size = tangent.norm();
    std::map<int, Vector6d> moved;  // by frame
    for (std::size_t k = i; k < moving_.size(); ++k) {
      if (motion[k].norm() < kTakesPart) continue;
      for (const int frame : rigid_.groups[At(moving_[k])].frames) {
        moved[frame] = Tangent(poses_[At(frame)], centres_[k], motion[k]) / size;
      }
    }
    GroupSlide slide;
    for (const auto& [frame, by] : moved) {
      slide.frames.push_back(frame);
      slide.motion.push_back(by);
    }
    slide.hold = {held_frame_[i], tangent / size};
    slide.twist << held.q * slide.hold.direction.head<3>(), slide.hold.direction.tail<3>();
    slide.sigma_m =
        information > 0.0 ? 1.0 / std::sqrt(information) : std::numeric_limits<double>::infinity();
    return slide;
  }

  const std::vector<SE3>& poses_;
  const RigidGroups& rigid_;
  const std::vector<int>& moving_;
  const double max_sigma_m_;
  std::vector<int> number_of_;   // among the moving groups
  std::vector<int> held_frame_;  // of each moving group
  std::vector<Eigen::Vector3d> centres_;
  std::vector<std::vector<Vector6d>> holds_;
  Eigen::MatrixXd H_;
  std::vector<Matrix6d> inverse_;  // of the pivots, without what is open
};

}  // namespace

std::vector<GroupSlide> FindSlides(const std::vector<SE3>& poses,
                                   const std::vector<std::vector<HeldDirection>>& open,
                                   double max_sigma_m, RigidGroups* rigid) {
  std::vector<GroupSlide> slides;
  for (;;) {
    std::vector<int> moving = MovingGroups(*rigid);
    if (moving.empty()) return slides;
    if (moving.size() > kMostTogether) moving.resize(kMostTogether);
    const std::vector<GroupSlide> found =
        JointMotion(poses, open, *rigid, moving, max_sigma_m).FindOpen();
    slides.insert(slides.end(), found.begin(), found.end());
    // Now that they are held, they stand; the rest may join them.
    const auto standing = static_cast<int>(rigid->groups.size()) - 1;
    std::vector<int> into(rigid->groups.size());
    for (std::size_t g = 0; g < into.size(); ++g) {
      into[g] = rigid->groups[g].stands ? standing : static_cast<int>(g);
    }
    for (const int g : moving) into[static_cast<std::size_t>(g)] = standing;
    JoinGroups(into, rigid);
    rigid->groups.back().stands = true;
    JoinRigidGroups(poses, max_sigma_m, rigid);
  }
}

}  // namespace lamina
