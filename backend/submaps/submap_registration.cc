#include "backend/submaps/submap_registration.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <utility>

#include "backend/submaps/map_assembly.h"
#include "core/base/angle.h"
#include "core/base/thinning.h"

namespace lamina {
namespace {

// What a pose between submaps may be off where no plane holds it.
constexpr double kOpenRotationDeg = 5.0, kOpenTranslationM = 1.0;
// What rises above a sensor by less may be a car that was parked there on one of both days.
constexpr double kAboveM = 0.3;
// So little of so many looks is none: of generated towns 0.1 % were gone at most, of two drives of
// one road 0.4 %, of a wood walked through twice nothing of 600 looks; where planes agreed as
// badly, in other towns 2 % at least, in another wood 26 %.
constexpr double kNoneGone = 0.005;
constexpr int kManyLooks = 300;
// Clusters that a descent looks at: more say nothing new of six unknowns.
constexpr std::size_t kCoarseClusters = 1500, kFineClusters = 6000;
// Leaves that are looked for from the other submap's keyframes: more say nothing new of a share.
constexpr std::size_t kSomeLeaves = 2000;

ScanMatcherOptions Coarse(ScanMatcherOptions options) {
  options.max_iterations = 15;
  options.kernel_start_sigma = 20.0;
  options.kernel_end_sigma = 4.0;
  options.max_distance_m *= 2.0;
  return WithinRange(options);
}

std::unique_ptr<VoxelMap> MapOf(const Submap& submap, const SubmapLeaves& leaves,
                                VoxelMapOptions options) {
  auto map = std::make_unique<VoxelMap>(options);
  AddLeaves(submap, leaves, SE3(), map.get());
  map->Refresh();
  return map;
}

std::vector<Eigen::Vector3f> SomeMeans(const Submap& submap, const SubmapLeaves& leaves) {
  const std::size_t stride = StrideToAtLeast(leaves.size(), kSomeLeaves);
  std::vector<Eigen::Vector3f> means;
  for (std::size_t i = 0; i < leaves.size(); i += stride)
    means.push_back(submap.Cluster(leaves[i]).mean.cast<float>());
  return means;
}

SightLines::Seen SeenOfEachOther(const SubmapQuery& query, const SubmapTarget& target,
                                 const SE3& T_target_query) {
  const Eigen::Vector3d up = T_target_query.q * query.up;
  return target.sight().LookAbove(query.some, T_target_query, up, kAboveM) +
         query.sight.LookAbove(target.some(), T_target_query.Inverse(), query.up, kAboveM);
}

double LeastOverlap(const SubmapMatch& match, const VerificationOptions& options) {
  return NoneIsGone(match) ? std::min(options.min_overlap, options.min_overlap_none_gone)
                           : options.min_overlap;
}

// Of wrong poses among vans less agrees, and 24 % are gone at least.
bool NearlyAllAgrees(const SubmapMatch& match) { return match.overlap >= 0.85; }

double MostGone(const SubmapMatch& match, const VerificationOptions& options) {
  return NearlyAllAgrees(match) ? std::max(options.max_gone, options.max_gone_agreeing)
                                : options.max_gone;
}

double StructureInCommon(const SubmapQuery& query, const VoxelMap& map, const SE3& T) {
  const double most_m = 0.5 * map.options().LeafSize();
  std::size_t met = 0;
  for (const Eigen::Vector3f& mean : query.upright) {
    const Eigen::Vector3d p = T * mean.cast<double>();
    // A large voxel may hold a wall alone: what stands before it is not there.
    const Surface* const plane = map.PlaneAt(p);
    if (plane != nullptr ? std::abs(plane->Distance(p)) <= most_m
                         : map.FindSurface(p) != VoxelMap::kNoNode)
      ++met;
  }
  return query.upright.empty()
             ? 0.0
             : static_cast<double>(met) / static_cast<double>(query.upright.size());
}

PosePrediction Open(const SE3& T) {
  PosePrediction prediction;
  prediction.T_world_lidar = T;
  const double rotation = Radians(kOpenRotationDeg);
  prediction.covariance.diagonal() << Eigen::Vector3d::Constant(rotation * rotation),
      Eigen::Vector3d::Constant(kOpenTranslationM * kOpenTranslationM);
  return prediction;
}

}  // namespace

void VerificationOptions::Visit(OptionVisitor& v) {
  v.Integer("min_planes", &min_planes, 1, 1000000);
  v.Number("min_overlap", &min_overlap, 0.0, 1.0);
  v.Number("min_overlap_none_gone", &min_overlap_none_gone, 0.0, 1.0);
  v.Number("min_structure", &min_structure, 0.0, 1.0);
  v.Number("min_facing", &min_facing, 0.0, 1e6);
  v.Number("max_residual_sigmas", &max_residual_sigmas, 0.0, 100.0);
  v.Number("max_gone", &max_gone, 0.0, 1.0);
  v.Number("max_gone_agreeing", &max_gone_agreeing, 0.0, 1.0);
}

bool NoneIsGone(const SubmapMatch& match) {
  return match.looks >= kManyLooks && match.gone <= kNoneGone;
}

bool LacksFarLess(const SubmapMatch& one, const SubmapMatch& other) {
  // Of furnished rooms turned by half a turn 4 to 10 times as much is not there as at the right
  // pose, in equal rooms with other furniture, where neither is right, 1.2 to 1.7 times.
  constexpr double kFar = 2.5;
  return kFar * (1.0 - one.structure) <= 1.0 - other.structure;
}

bool FitsClearlyBetter(const SubmapMatch& one, const SubmapMatch& other) {
  // A furnished room turned by half a turn lacks 5 % of the structure, where the right pose lacks
  // 0.1 to 1 %, and the squares of its distances are twice as large.
  constexpr double kClearly = 1.5;
  const double lacks = 1.0 - one.structure, other_lacks = 1.0 - other.structure;
  const double square = one.residual_sigmas * one.residual_sigmas,
               other_square = other.residual_sigmas * other.residual_sigmas;
  return one.planes >= other.planes && one.overlap >= other.overlap && lacks <= other_lacks &&
         square <= other_square &&
         (kClearly * lacks <= other_lacks || kClearly * square <= other_square);
}

std::string Refusal(const SubmapMatch& match, const VerificationOptions& options) {
  if (!match.met_planes) return "registration did not converge";
  if (match.planes < options.min_planes) return "few planes agree";
  if (match.overlap < LeastOverlap(match, options)) return "planes do not agree";
  if (match.structure < options.min_structure) return "structure does not agree";
  if (match.residual_sigmas > options.max_residual_sigmas) return "planes do not fit";
  if (match.gone > MostGone(match, options)) return "what one has the other saw past";
  if (match.facing < options.min_facing) return "open along a horizontal direction";
  return "";
}

bool MayBeRight(const SubmapMatch& match, VerificationOptions options) {
  constexpr double kGoneFactor = 2.0, kOverlapFactor = 0.5;
  options.min_facing = 0.0;
  options.min_overlap_none_gone *= kOverlapFactor;
  if (NoneIsGone(match) || NearlyAllAgrees(match)) options.min_structure = 0.0;
  options.max_gone_agreeing *= kGoneFactor;
  return Refusal(match, options).empty();
}

SubmapTarget::SubmapTarget(const Submap& submap, const VoxelMapOptions& map) {
  const SubmapLeaves leaves = submap.Leaves();
  VoxelMapOptions options = map;
  options.budget_mb = VoxelMapOptions::kMostBudgetMb;
  fine_ = MapOf(submap, leaves, options);
  options.root_size_m *= 2.0;
  options.max_thickness_m *= 2.0;
  options.noise_floor_m = std::max(options.noise_floor_m, 0.05);
  coarse_ = MapOf(submap, leaves, WithinRange(options));
  some_ = SomeMeans(submap, leaves);
  sight_ = SightLines(submap, leaves);
}

SubmapQuery MakeQuery(const Submap& submap, std::vector<LeafPlane> planes,
                      const Eigen::Vector3d& up) {
  SubmapQuery query;
  const SubmapLeaves leaves = submap.Leaves();
  query.clusters.reserve(leaves.size());
  for (const SubmapLeaf& leaf : leaves) query.clusters.push_back(submap.Cluster(leaf));
  query.upright = UprightLeaves(submap, planes, up);
  query.some = SomeMeans(submap, leaves);
  query.planes = std::move(planes);
  query.up = up;
  query.sight = SightLines(submap, leaves);
  return query;
}

SubmapRegistration::SubmapRegistration(const ScanMatcherOptions& matcher)
    : options_(matcher), coarse_(Coarse(matcher)), fine_(matcher) {}

MatchResult SubmapRegistration::Descend(const std::vector<PointCluster>& clusters,
                                        const SubmapTarget& target, const SE3& T_target_clusters,
                                        bool coarse) const {
  SE3 start = T_target_clusters;
  if (coarse) {
    MatchResult first =
        coarse_.MatchPose(Thinned(clusters, kCoarseClusters), Open(start), target.coarse());
    if (first.status == MatchResult::Status::kTooFewMatches) return first;
    start = first.T_world_lidar;
  }
  return fine_.Match(Thinned(clusters, kFineClusters), Open(start), target.fine());
}

SubmapMatch SubmapRegistration::Register(const SubmapQuery& query, const SubmapTarget& target,
                                         const SE3& T_target_query, bool coarse) const {
  SubmapMatch match;
  const MatchResult descent = Descend(query.clusters, target, T_target_query, coarse);
  match.T_other_query = descent.T_world_lidar;
  if (descent.status == MatchResult::Status::kTooFewMatches) return match;
  match.met_planes = true;
  match.covariance = descent.covariance;
  JudgePlanes(query, target.fine(), &match);
  match.structure = StructureInCommon(query, target.fine(), match.T_other_query);
  const SightLines::Seen seen = SeenOfEachOther(query, target, match.T_other_query);
  match.gone = seen.GoneShare();
  match.looks = seen.there + seen.gone;
  return match;
}

void SubmapRegistration::JudgePlanes(const SubmapQuery& query, const VoxelMap& map,
                                     SubmapMatch* match) const {
  constexpr float kSameCosine = 0.94F;
  constexpr double kSigmas = 3.0;
  const double noise_floor_m = map.options().noise_floor_m, floor2 = noise_floor_m * noise_floor_m;
  const Eigen::Matrix3f R = match->T_other_query.R().cast<float>();
  const Eigen::Vector3f up = R * query.up.cast<float>();
  int on_planes = 0, agreeing = 0;
  double squares = 0.0;
  Eigen::Matrix3f facing = Eigen::Matrix3f::Zero();
  for (const LeafPlane& plane : query.planes) {
    const Eigen::Vector3d p = match->T_other_query * plane.mean.cast<double>();
    const Surface* const plane_there = map.PlaneAt(p);
    if (plane_there == nullptr) continue;
    const Surface& surface = *plane_there;
    // Ground lies on ground anywhere.
    const bool upright = !LiesFlat(plane, query.up);
    on_planes += upright ? 1 : 0;
    const Eigen::Vector3f normal = R * plane.normal;
    if (std::abs(normal.dot(surface.normal)) < kSameCosine) continue;
    const double distance = surface.Distance(p);
    const double square =
        distance * distance / (floor2 + static_cast<double>(surface.variance + plane.variance));
    if (square > kSigmas * kSigmas) continue;
    ++match->planes;
    squares += square;
    if (!upright) continue;
    ++agreeing;
    const Eigen::Vector3f horizontal = normal - up.dot(normal) * up;
    facing += horizontal * horizontal.transpose();
  }
  if (match->planes == 0) return;
  match->overlap = on_planes > 0 ? static_cast<double>(agreeing) / on_planes : 0.0;
  match->residual_sigmas = std::sqrt(squares / match->planes);
  // The least of the three is that of the vertical: about zero.
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3f> eigen(facing);
  match->facing = static_cast<double>(eigen.eigenvalues()(1));
}

}  // namespace lamina
