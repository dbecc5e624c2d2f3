#include "frontend/matching/scan_matcher.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "core/base/angle.h"
#include "frontend/matching/block_votes.h"
#include "frontend/matching/map_residuals.h"
#include "frontend/matching/plane_score.h"

namespace lamina {
namespace {

constexpr int kMinMatches = 10;
// A direction that more clusters face does not rest on planes that are seen through
// (seen_through.h).
constexpr double kFewFacing = 100.0;

// The degenerate directions at one linearisation, and how they are held.
struct Held {
  Matrix6d directions = Matrix6d::Zero();  // the first `count` columns
  Vector6d facing = Vector6d::Zero();      // information that counts, 1/m^2
  Vector6d seeming = Vector6d::Zero();     // information that the normal matrix has
  Vector6d prior = Vector6d::Zero();       // information of the prediction
  int count = 0;
};

Matrix6d EigenvectorsOf(const Matrix6d& H, double* smallest) {
  const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(H);
  *smallest = solver.eigenvalues()(0);
  return solver.eigenvectors();
}

double SmallestEigenvalue(const Matrix6d& H) {
  return Eigen::SelfAdjointEigenSolver<Matrix6d>(H, Eigen::EigenvaluesOnly).eigenvalues()(0);
}

// Gauss-Newton from a start to a minimum.
class Descent {
 public:
  // `known`: a direction along which the pose stays where it starts, or null.
  Descent(const ScanMatcherOptions& options, const PosePrediction& prediction,
          const KnownDirection* known, MapResiduals* residuals)
      : options_(options), prediction_(prediction), known_(known), residuals_(residuals) {}

  // Fills pose, status, iterations, degeneracy and, if asked for, covariance. False if there are
  // too few matches.
  bool Run(const SE3& initial, bool with_covariance, MatchResult* result) {
    // Without the dropped planes the pose moves, and may meet further ones that the scan sees
    // through.
    constexpr int kMostRounds = 3;
    T_ = T_known_ = initial;
    double kernel = known_ == nullptr ? options_.kernel_start_sigma : options_.kernel_end_sigma;
    for (int round = 1;; ++round) {
      if (!Descend(kernel, result)) return false;
      if (!DropFeigned()) break;
      kernel = options_.kernel_end_sigma;
      if (round < kMostRounds) continue;
      // What is reported rests on no plane that is seen through, though the pose was found with
      // some.
      if (!Linearise(kernel, false, true)) return false;
      break;
    }
    Report(result);
    if (with_covariance) result->covariance = Covariance(&result->block_step);
    return true;
  }

  const NormalEquations& equations() const { return eq_; }

 private:
  bool Descend(double kernel, MatchResult* result) {
    result->status = MatchResult::Status::kIterationLimit;
    for (int i = 0; i < options_.max_iterations; ++i) {
      const bool narrow = kernel <= options_.kernel_end_sigma;
      ++result->iterations;
      if (!Linearise(kernel, i == 0, i == 0 || narrow)) return false;
      Vector6d step = Step();
      if (!step.allFinite()) return false;
      // Associations hold for about a voxel, which limits the length of a step.
      step *= std::min(1.0, 0.5 * residuals_->map().options().root_size_m / step.norm());
      step = DividedByArm(step);
      T_ = Retract(T_, step);
      kernel = std::max(options_.kernel_end_sigma, 0.5 * kernel);
      if (narrow && step.head<3>().norm() < Radians(options_.min_rotation_step_deg) &&
          step.tail<3>().norm() < options_.min_translation_step_m) {
        result->status = MatchResult::Status::kConverged;
        return true;
      }
    }
    // Linearises at the last pose, to which what is reported belongs.
    return Linearise(options_.kernel_end_sigma, false, true);
  }

  // If few clusters face the weakest direction and most of them lie on planes that the scan sees
  // through, drops these planes. False if not.
  bool DropFeigned() {
    // All planes of that kind together do not determine a direction as well as this.
    constexpr double kCertainM = 0.003;
    if (smallest_ * kCertainM * kCertainM > 1.0) return false;
    const bool watched = !eq_.all.information.isZero();
    const DirectionEvidence evidence =
        watched ? eq_.all : residuals_->EvidenceAt(T_, options_.kernel_end_sigma, basis_).all;
    if (evidence.Facing(0) >= kFewFacing) return false;
    const Vector6d v = evidence.directions.col(0);
    const MetPlanes met = residuals_->Meet(T_, options_.kernel_end_sigma, v);
    const SeenThrough seen = residuals_->FindSeenThrough(met, v, v.dot(feigned_ * v));
    const Matrix6d feigned = feigned_ + DividedByArm(seen.H), opaque = DividedByArm(seen.H_opaque);
    if (seen.planes.empty() || !MostlyFeigned(v, feigned, opaque) || !residuals_->OfOneSensor(met))
      return false;
    feigned_ = feigned;
    opaque_ = opaque;
    residuals_->Drop(seen.planes);
    return true;
  }

  // Whether planes that are seen through would determine a direction, and carry most of the
  // information along it. The other planes along it are then of the same kind: only no beam happens
  // to pass them.
  bool MostlyFeigned(const Vector6d& v, const Matrix6d& feigned, const Matrix6d& opaque) const {
    const double least = 1.0 / (options_.max_direction_sigma_m * options_.max_direction_sigma_m);
    return v.dot(feigned * v) > std::max(least, v.dot(opaque * v));
  }

  // Linearises at the present pose. `decide`: determines anew which directions are degenerate.
  bool Linearise(double kernel, bool first, bool decide) {
    if (first) Begin(kernel);
    // The eigenvectors are those of the step before: they turn little.
    const bool watch = decide && Doubtful();
    if (!first) eq_ = residuals_->At(T_, kernel, watch ? &basis_ : nullptr);
    if (eq_.matched < kMinMatches) return false;
    if (decide) held_ = Decide(watch);
    if (held_.count > (known_ == nullptr ? 0 : 1) && !residuals_->use_rough) {
      residuals_->use_rough = true;
      eq_ = residuals_->At(T_, kernel, &basis_);
      held_ = Decide(true);
    }
    if (!first) FindDirections();
    return true;
  }

  // Linearises where a descent begins, with evidence if it is needed: planes that are met flatly
  // (line_of_sight.h) take part unless the others determine all directions well.
  void Begin(double kernel) {
    LineariseWith(/*flat=*/false, kernel);
    if (!WellDetermined()) LineariseWith(/*flat=*/true, kernel);
  }

  void LineariseWith(bool flat, double kernel) {
    residuals_->use_flat = flat;
    eq_ = residuals_->At(T_, kernel, nullptr);
    FindDirections();
    if (!Doubtful()) return;
    const NormalEquations evidence = residuals_->EvidenceAt(T_, kernel, basis_);
    eq_.all = evidence.all;
    eq_.old = evidence.old;
  }

  bool WellDetermined() {
    constexpr double kWell = 0.4;  // of the sigma that makes a direction degenerate
    if (eq_.matched < kMinMatches) return false;
    if (!Doubtful()) return true;
    return DecideByEvidence().count == 0 &&
           worst_sigma_m_ <= kWell * options_.max_direction_sigma_m;
  }

  // Eigenvectors of the normal matrix: a direction that is known is one of them, and the last.
  void FindDirections() {
    basis_ = EigenvectorsOf(WithKnown(DividedByArm(eq_.H)), &smallest_);
    // Information from lines of single rings does not count.
    if (residuals_->use_rough)
      smallest_ = SmallestEigenvalue(WithKnown(DividedByArm(Matrix6d(eq_.H - eq_.H_rings))));
  }

  Matrix6d WithKnown(const Matrix6d& H) const {
    if (known_ == nullptr) return H;
    Vector6d most = Vector6d::Zero();
    most(0) = H.trace();
    Matrix6d direction = Matrix6d::Zero();
    direction.col(0) = known_->direction;
    return WithHeld(H, direction, most);
  }

  // Whether evidence must be gathered: not if the smallest eigenvalue is far above what wrong
  // normals can feign, so that all directions are known well.
  bool Doubtful() const {
    constexpr double kClearShare = 0.02, kClearMargin = 10.0;
    const double least = 1.0 / (options_.max_direction_sigma_m * options_.max_direction_sigma_m);
    return smallest_ < std::max(kClearShare * eq_.weight, kClearMargin * least);
  }

  Held Decide(bool watched) {
    Held held = watched ? DecideByEvidence() : Held();
    if (!watched)
      worst_sigma_m_ = smallest_ > 0.0 ? 1.0 / std::sqrt(smallest_) : MatchResult::kUnknownSigmaM;
    degenerate_ = held.count;
    if (known_ == nullptr) return held;
    const Vector6d& v = known_->direction;
    held.directions.col(held.count) = v;
    held.seeming(held.count) = v.dot(DividedByArm(eq_.H) * v);
    held.prior(held.count) = 1.0 / (known_->sigma_m * known_->sigma_m);
    ++held.count;
    worst_sigma_m_ = std::max(worst_sigma_m_, known_->sigma_m);
    if (known_->sigma_m > options_.max_direction_sigma_m) ++degenerate_;
    return held;
  }

  Held DecideByEvidence() {
    Held held;
    worst_sigma_m_ = 0.0;
    // Planes that few frames have seen move along with the sensor: they count only as long as there
    // are too few others, as on the first scans.
    const DirectionEvidence& evidence = eq_.matched_old >= kMinMatches ? eq_.old : eq_.all;
    const Matrix6d H = DividedByArm(eq_.H);
    for (int k = 0; k < (known_ == nullptr ? 6 : 5); ++k) {
      const Vector6d v = basis_.col(k);
      const bool feigned = evidence.Facing(k) < kFewFacing && MostlyFeigned(v, feigned_, opaque_);
      const double sigma_m = feigned ? MatchResult::kUnknownSigmaM : evidence.Sigma(k);
      worst_sigma_m_ = std::max(worst_sigma_m_, std::min(sigma_m, MatchResult::kUnknownSigmaM));
      if (!feigned &&
          !evidence.Degenerate(k, options_.max_direction_sigma_m, options_.min_facing_clusters))
        continue;
      held.directions.col(held.count) = v;
      held.facing(held.count) = feigned ? 0.0 : evidence.information(k);
      held.seeming(held.count) = v.dot(H * v);
      held.prior(held.count) = prediction_.Information(v);
      ++held.count;
    }
    return held;
  }

  // Normal matrix (scaled) in which a held direction carries what counts and the prediction.
  Matrix6d Information() const {
    return WithHeld(DividedByArm(eq_.H), held_.directions, held_.facing + held_.prior);
  }

  Vector6d Step() const {
    const Matrix6d keep = Matrix6d::Identity() - held_.directions * held_.directions.transpose();
    const Vector6d gradient = DividedByArm(eq_.g);
    const Vector6d from_prediction = ScaledDelta(prediction_.T_world_lidar, T_);
    Vector6d g = keep * gradient;
    for (int k = 0; k < held_.count; ++k) {
      const Vector6d v = held_.directions.col(k);
      const bool known = known_ != nullptr && k + 1 == held_.count;
      const Vector6d off = known ? ScaledDelta(T_known_, T_) : from_prediction;
      const double share = held_.seeming(k) > 0.0 ? held_.facing(k) / held_.seeming(k) : 0.0;
      g += (std::min(1.0, share) * v.dot(gradient) + held_.prior(k) * v.dot(off)) * v;
    }
    // The factorisation needs a positive matrix even where nothing is known.
    const Matrix6d damped = Information() + 1e-9 * eq_.weight * Matrix6d::Identity();
    return -damped.ldlt().solve(g);
  }

  void Report(MatchResult* result) {
    result->T_world_lidar = T_;
    result->worst_sigma_m = worst_sigma_m_;
    result->weakest_direction = basis_.col(0);
    result->degenerate = degenerate_;
    // Factor by which the reported information outweighs what planes only seem to say.
    constexpr double kAgainstSeeming = 10.0;
    const int held = held_.count - (known_ == nullptr ? 0 : 1);
    result->degenerate_directions.leftCols(held) = held_.directions.leftCols(held);
    for (int k = 0; k < held; ++k) {
      const double seeming = std::max(0.0, held_.seeming(k) - held_.facing(k));
      result->degenerate_information(k) =
          held_.facing(k) + held_.prior(k) + kAgainstSeeming * seeming;
    }
    result->prior_information =
        held_.directions * held_.prior.asDiagonal() * held_.directions.transpose();
  }

  Matrix6d Covariance(BlockStep* step) const {
    const Matrix6d damped = Information() + 1e-9 * eq_.weight * Matrix6d::Identity();
    const Matrix6d inverse = damped.ldlt().solve(Matrix6d::Identity());
    const Matrix6d keep = Matrix6d::Identity() - held_.directions * held_.directions.transpose();
    Matrix6d scatter =
        keep * DividedByArm(residuals_->GradientScatter(T_, options_.kernel_end_sigma, step)) *
        keep;
    const Vector6d held = held_.facing + held_.prior;
    scatter += held_.directions * held.asDiagonal() * held_.directions.transpose();
    return DividedByArm(Matrix6d(inverse * scatter * inverse));
  }

  const ScanMatcherOptions& options_;
  const PosePrediction& prediction_;
  const KnownDirection* known_;
  MapResiduals* residuals_;
  SE3 T_, T_known_;
  NormalEquations eq_;
  Matrix6d basis_ = Matrix6d::Identity();
  double smallest_ = 0.0;
  // Scaled information of planes that are seen through, and of the others that face the direction.
  Matrix6d feigned_ = Matrix6d::Zero(), opaque_ = Matrix6d::Zero();
  double worst_sigma_m_ = 0.0;
  int degenerate_ = 0;
  Held held_;
};

}  // namespace

void MatchResult::MakeDegenerate(const Vector6d& direction) {
  if (degenerate > 0) return;
  degenerate = 1;
  degenerate_directions.col(0) = direction;
}

void MatchResult::MayBeElsewhere(const Vector6d& elsewhere) {
  covariance += elsewhere * elsewhere.transpose();
  MakeDegenerate(TimesArm(elsewhere).normalized());
}

ScanMatcherOptions WithNarrowKernel(ScanMatcherOptions options) {
  options.kernel_start_sigma = options.kernel_end_sigma;
  return options;
}

void ScanMatcherOptions::Visit(OptionVisitor& v) {
  v.Integer("max_iterations", &max_iterations, 1, 1000);
  v.Number("min_rotation_step_deg", &min_rotation_step_deg, 1e-9, 10.0);
  v.Number("min_translation_step_m", &min_translation_step_m, 1e-9, 10.0);
  v.Integer("young_frames", &young_frames, 1, 1000);
  v.Number("young_sigma_m", &young_sigma_m, 0.0, 10.0);
  v.Number("kernel_start_sigma", &kernel_start_sigma, 0.1, 1e3);
  v.Number("kernel_end_sigma", &kernel_end_sigma, 0.1, 1e3);
  v.Number("max_distance_m", &max_distance_m, 0.01, 100.0);
  v.Number("max_direction_sigma_m", &max_direction_sigma_m, 1e-4, 1e6);
  v.Integer("min_facing_clusters", &min_facing_clusters, 1, 1000);
}

double PosePrediction::Information(const Vector6d& direction) const {
  const double variance = direction.dot(TimesArm(covariance) * direction);
  constexpr double kLeast = 1e-6;  // m^2: nothing is predicted to a millimetre
  return 1.0 / std::max(variance, kLeast);
}

ScanMatcher::ScanMatcher(const ScanMatcherOptions& options) : options_(options) {
  CheckOptions(options, "frontend.matcher");
}

MatchResult ScanMatcher::Run(const std::vector<PointCluster>& clusters,
                             const PosePrediction& prediction, const SE3& initial,
                             const KnownDirection* known, const VoxelMap& map,
                             bool with_covariance) const {
  MatchResult result;
  result.clusters = static_cast<int>(clusters.size());
  MapResiduals residuals(options_, map, clusters);
  Descent descent(options_, prediction, known, &residuals);
  if (!descent.Run(initial, with_covariance, &result)) {
    result.status = MatchResult::Status::kTooFewMatches;
    result.T_world_lidar = initial;
  }
  const NormalEquations& eq = descent.equations();
  result.matched = eq.matched;
  result.inlier_share = eq.robust / static_cast<double>(std::max<std::size_t>(1, clusters.size()));
  result.residual_rms_m = std::sqrt(eq.residual2 / std::max(eq.robust, 1e-9));
  return result;
}

MatchResult ScanMatcher::MatchKnown(const std::vector<PointCluster>& clusters,
                                    const SE3& T_world_lidar, const KnownDirection& known,
                                    const PosePrediction& prediction, const VoxelMap& map) const {
  return Run(clusters, prediction, T_world_lidar, &known, map, true);
}

DirectionEvidence ScanMatcher::EvidenceOf(const PlanesInstead& planes,
                                          const std::vector<PointCluster>& clusters,
                                          const SE3& T_world_lidar, const VoxelMap& map,
                                          const Matrix6d& directions) const {
  MapResiduals residuals(options_, map, clusters);
  return residuals.EvidenceOf(planes, T_world_lidar, options_.kernel_end_sigma, directions);
}

double ScanMatcher::Score(const std::vector<PointCluster>& clusters, const SE3& T_world_lidar,
                          const VoxelMap& map, double scale_m, std::size_t stride,
                          double chance) const {
  const PlaneScore score(T_world_lidar, map, scale_m, chance);
  double sum = 0.0;
  std::size_t visited = 0;
  score.OfEach(clusters, stride, [&](double fit) {
    ++visited;
    sum += PlaneScore::OrNothing(fit);
  });
  return visited == 0 ? 0.0 : sum / static_cast<double>(visited);
}

FitDifference ScanMatcher::Compare(const std::vector<PointCluster>& clusters, const SE3& ours,
                                   const SE3& theirs, const VoxelMap& map, double scale_m) const {
  constexpr double kDecisive = 0.3, kChance = MatchResult::kChanceFit;
  const PlaneScore our_score(ours, map, scale_m, kChance);
  const PlaneScore their_score(theirs, map, scale_m, kChance);
  double our_votes = 0.0, their_votes = 0.0, sum = 0.0, squares = 0.0;
  for (const PointCluster& cluster : clusters) {
    const double evidence = PlaneScore::OrNothing(our_score.Of(cluster)) -
                            PlaneScore::OrNothing(their_score.Of(cluster));
    our_votes += evidence > kDecisive ? 1.0 : 0.0;
    their_votes += evidence < -kDecisive ? 1.0 : 0.0;
    sum += evidence;
    squares += evidence * evidence;
  }
  FitDifference result;
  const double votes = our_votes + their_votes;
  if (votes > 0.0) result.votes_sigmas = (our_votes - their_votes) / std::sqrt(votes);
  if (squares > 0.0) result.evidence_sigmas = sum / std::sqrt(squares);
  if (!clusters.empty()) result.evidence = sum / static_cast<double>(clusters.size());
  return result;
}

double ScanMatcher::CompareBlocks(const std::vector<PointCluster>& clusters, const SE3& ours,
                                  const SE3& theirs, const VoxelMap& map, double scale_m) const {
  PlaceVotes votes(map, scale_m);
  votes.Add(clusters, ours, theirs);
  return votes.Sigmas();
}

}  // namespace lamina
