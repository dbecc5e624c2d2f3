// Registration of one submap against another on their clusters, and what speaks for it.
//
// The pose starts at a hypothesis (place_lookup.h) and descends by the scan matcher's
// point-to-plane, first in voxels of twice the size with a wide kernel, then in those of the map.
// Fit alone believes aliases: what repeats, such as doors of a corridor or houses of a street, fits
// where it is not. So evidence is told apart, at the pose reached:
//
//     planes     planar leaves of the query that lie on a plane of the other one and agree with it
//                in direction and within 3 sigma: a number
//     overlap    of those that do not lie flat, the share that agrees, of all that lie on planes of
//                the other one: ground lies on ground anywhere
//     structure  share of the query's leaves that do not lie flat where the other one has anything
//                at all, on its plane where it has one: also what is no plane must be there
//     residual   root mean square of the distances of those that agree, in sigmas: the planes' own
//                thickness and the noise floor
//     gone       share of what rises above the sensor in one of them, and should show in the other,
//                that keyframes of the other saw past (sight_lines.h). Where neither looked it says
//                nothing; cars that were parked there on one day do not rise so far. Where next to
//                nothing of much is gone, less overlap is enough: leaves of trees are seldom planes
//                that agree. Where nearly all planes agree, more may be gone: vans and lorries that
//                were parked there on one day
//     facing     smallest eigenvalue of the sum of h h' over those that agree, h being the
//                horizontal part of the normal: how many planes hold the place in the direction
//                that the fewest hold, e.g. along a street. A number of planes, so that more ground
//                changes nothing
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "backend/submaps/level_frame.h"
#include "backend/submaps/sight_lines.h"
#include "backend/submaps/submap.h"
#include "core/map/voxel_map.h"
#include "core/options/options.h"
#include "frontend/matching/scan_matcher.h"

namespace lamina {

struct VerificationOptions {
  // Of a loop that is to be believed, at least.
  int min_planes = 60;
  double min_overlap = 0.7;
  double min_overlap_none_gone = 0.4;  // where all that should show does
  double min_structure = 0.45;
  double min_facing = 4.0;
  // At most.
  double max_residual_sigmas = 1.5;
  double max_gone = 0.02;
  double max_gone_agreeing = 0.06;  // between drives, where nearly all planes agree

  void Visit(OptionVisitor& v);
};

struct SubmapMatch {
  SE3 T_other_query;
  // Of T_other_query in the tangent of core/geometry/se3.h, submaps taken as rigid.
  Matrix6d covariance = Matrix6d::Identity();
  bool met_planes = false;  // enough for the descent; if not, the rest says nothing
  int planes = 0;
  double overlap = 0.0, structure = 0.0, residual_sigmas = 0.0, facing = 0.0, gone = 0.0;
  int looks = 0;  // that `gone` is a share of
};

// Whether each looked at enough of what the other has above the sensor, and all of it was there.
// What has nothing beside it in the other one lies where that one did not look.
bool NoneIsGone(const SubmapMatch& match);

// Whether the first of two poses of one pair of submaps is better by all figures, and clearly by
// one of them.
bool FitsClearlyBetter(const SubmapMatch& one, const SubmapMatch& other);

// Whether so much less of the first one's structure is missing that the second pose, half a turn
// from it, is none that the place would fit as well.
bool LacksFarLess(const SubmapMatch& one, const SubmapMatch& other);

// Why a match is not to be believed; empty if it is.
std::string Refusal(const SubmapMatch& match, const VerificationOptions& options);

// Whether one that is not may be right all the same, where others expect it: open along a street,
// it could lie elsewhere as well, but need not; and of two submaps that overlap in part, each has
// planes and structure where the other did not look, and what was parked there on one day shows in
// fewer looks.
bool MayBeRight(const SubmapMatch& match, VerificationOptions options);

// A submap that others are registered against. Immutable; thread-safe.
class SubmapTarget {
 public:
  // `map`: sizes and thresholds of the fine voxels.
  SubmapTarget(const Submap& submap, const VoxelMapOptions& map);

  const VoxelMap& coarse() const { return *coarse_; }
  const VoxelMap& fine() const { return *fine_; }
  const std::vector<Eigen::Vector3f>& some() const { return some_; }
  const SightLines& sight() const { return sight_; }

 private:
  std::unique_ptr<VoxelMap> coarse_, fine_;
  std::vector<Eigen::Vector3f> some_;  // means of leaves, over all of it
  SightLines sight_;
};

// A submap that is registered against others.
struct SubmapQuery {
  std::vector<PointCluster> clusters;    // its frame
  std::vector<Eigen::Vector3f> some;     // means of some of them, over all of it
  std::vector<Eigen::Vector3f> upright;  // means of those that do not lie flat
  std::vector<LeafPlane> planes;
  Eigen::Vector3d up = Eigen::Vector3d::UnitZ();
  SightLines sight;
};
SubmapQuery MakeQuery(const Submap& submap, std::vector<LeafPlane> planes,
                      const Eigen::Vector3d& up);

// Stateless; thread-safe.
class SubmapRegistration {
 public:
  explicit SubmapRegistration(const ScanMatcherOptions& matcher);

  // Descends from a pose; what is too little to match leaves it there. `coarse`: the start may be
  // off by a cell of the place images; otherwise by some 0.2 m.
  MatchResult Descend(const std::vector<PointCluster>& clusters, const SubmapTarget& target,
                      const SE3& T_target_clusters, bool coarse) const;
  // The same of a submap, and what speaks for it.
  SubmapMatch Register(const SubmapQuery& query, const SubmapTarget& target,
                       const SE3& T_target_query, bool coarse = true) const;

 private:
  void JudgePlanes(const SubmapQuery& query, const VoxelMap& map, SubmapMatch* match) const;

  ScanMatcherOptions options_;
  ScanMatcher coarse_, fine_;
};

}  // namespace lamina
