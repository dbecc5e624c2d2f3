#include "frontend/odometry.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

namespace lamina {
namespace {

// Distance of a match from the prediction in standard deviations of both.
double SigmasApart(const PosePrediction& prediction, const MatchResult& match) {
  const Vector6d delta = LocalDelta(prediction.T_world_lidar, match.T_world_lidar);
  const Matrix6d both = prediction.covariance + match.covariance;
  return std::sqrt(std::max(0.0, delta.dot(both.ldlt().solve(delta))));
}

// Largest standard deviation over all directions of the scaled tangent, metres.
double WorstSigma(const Matrix6d& covariance) {
  Matrix6d scaled = covariance;
  scaled.topRows<3>() *= kRotationArmM;
  scaled.leftCols<3>() *= kRotationArmM;
  const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(scaled, Eigen::EigenvaluesOnly);
  return std::sqrt(std::max(0.0, solver.eigenvalues()(5)));
}

}  // namespace

void OdometryOptions::Visit(OptionVisitor& v) {
  v.Integer("deskew_passes", &deskew_passes, 0, 10);
  v.Number("lost_inlier_ratio", &lost_inlier_ratio, 0.0, 1.0);
  v.Number("doubtful_fit_ratio", &doubtful_fit_ratio, 0.0, 1.0);
  v.Number("min_overlap", &min_overlap, 0.0, 1.0);
  v.Number("max_prediction_sigmas", &max_prediction_sigmas, 0.5, 1e3);
  v.Number("vouched_gap_s", &vouched_gap_s, 0.0, 1e6);
  v.Number("max_sigma_m", &max_sigma_m, 0.001, 1e3);
  v.Group("motion", &motion);
  v.Group("matcher", &matcher);
  v.Group("search", &search);
}

Odometry::Odometry(const OdometryOptions& options)
    : options_(options),
      matcher_(options.matcher),
      search_(options.search, &matcher_),
      motion_(options.motion) {
  CheckOptions(options, "frontend");
}

OdometryFrame Odometry::Register(StampNs stamp_ns, const std::vector<TimedCluster>& clusters,
                                 const VoxelMap& map, bool map_is_older) const {
  OdometryFrame frame;
  frame.stamp_ns = stamp_ns;
  if (!started()) return frame;
  const PosePrediction prediction = motion_.Predict(stamp_ns);
  frame.T_world_predicted = prediction.T_world_lidar;
  frame.twist = motion_.Twist(stamp_ns);
  std::vector<PointCluster> deskewed = DeskewClusters(clusters, frame.twist);
  const double dt = motion_.Gap(stamp_ns);
  const bool timed = AnyTimed(clusters) && dt > 0.0 && dt <= options_.vouched_gap_s;
  const int passes = timed ? options_.deskew_passes : 0;
  frame.match = passes > 0 ? matcher_.MatchPose(deskewed, prediction, map)
                           : matcher_.Match(deskewed, prediction, map);
  std::vector<SE3> hypotheses;
  if (options_.search.enabled && (map_is_older || NeedsSearch(frame.match, prediction))) {
    hypotheses = Hypotheses(prediction, map_is_older);
    frame.searched = !hypotheses.empty();
  }
  if (frame.searched) {
    frame.match = search_.Best(deskewed, hypotheses, frame.match, prediction, map);
    if (passes == 0)
      frame.match = matcher_.Match(deskewed, prediction, frame.match.T_world_lidar, map);
  }
  for (int pass = 0; pass < passes; ++pass) {
    frame.twist = TwistLog(motion_.T_world_last().Inverse() * frame.match.T_world_lidar) / dt;
    deskewed = DeskewClusters(clusters, frame.twist);
    frame.match = matcher_.Match(deskewed, prediction, frame.match.T_world_lidar, map);
  }
  frame.T_world_lidar = frame.match.T_world_lidar;
  frame.status = OdometryFrame::Status::kTracked;
  if (!Believed(frame, prediction, [&] {
        return search_.Unique(deskewed, hypotheses, frame.match, prediction, map);
      })) {
    frame.status = OdometryFrame::Status::kLost;
    frame.T_world_lidar = frame.T_world_predicted;
  }
  return frame;
}

bool Odometry::NeedsSearch(const MatchResult& match, const PosePrediction& prediction) const {
  const PoseSearchOptions& o = options_.search;
  // Matching reaches as far as planes are wide.
  constexpr double kReachM = 0.5;
  if (lost_ || std::sqrt(prediction.covariance.diagonal().tail<3>().maxCoeff()) > kReachM)
    return true;
  if (match.status == MatchResult::Status::kTooFewMatches) return true;
  if (Leaps(match, prediction)) return true;
  return match.inlier_share < o.trigger_inlier_ratio * RecentInliers();
}

bool Odometry::Leaps(const MatchResult& match, const PosePrediction& prediction) const {
  const SE3& a = prediction.T_world_lidar;
  const SE3& b = match.T_world_lidar;
  return RotationAngle(a, b) > options_.search.trigger_rotation_deg * M_PI / 180.0 ||
         (a.t - b.t).norm() > options_.search.trigger_translation_m;
}

std::vector<SE3> Odometry::Hypotheses(const PosePrediction& prediction, bool map_is_older) const {
  const SE3& centre = prediction.T_world_lidar;
  // The first match has no speed, and the second none yet.
  const bool starting = !motion_.moving_known() || (map_is_older && recent_inliers_.size() < 2);
  std::vector<SE3> hypotheses;
  if (starting) hypotheses = search_.OffsetsAbout(centre);
  if (map_is_older && starting) return hypotheses;
  const std::vector<SE3> turns = search_.TurnsAbout({centre, motion_.T_world_last()});
  hypotheses.insert(hypotheses.end(), turns.begin(), turns.end());
  const Eigen::Vector3d way = centre.t - motion_.T_world_last().t;
  constexpr double kLeastWayM = 0.1;
  if (!starting && way.norm() > kLeastWayM) {
    const std::vector<SE3> along = search_.AlongTheWay(prediction, way.normalized(), way.norm());
    hypotheses.insert(hypotheses.end(), along.begin(), along.end());
  }
  return hypotheses;
}

bool Odometry::Believed(const OdometryFrame& frame, const PosePrediction& prediction,
                        const std::function<bool()>& unique) const {
  const MatchResult& match = frame.match;
  if (match.status == MatchResult::Status::kTooFewMatches) return false;
  const bool gap = lost_ || motion_.Gap(frame.stamp_ns) > options_.vouched_gap_s;
  const bool vouched = !gap && (!Leaps(match, prediction) ||
                                SigmasApart(prediction, match) <= options_.max_prediction_sigmas);
  if (match.inlier_share < options_.lost_inlier_ratio * RecentInliers()) return false;
  if (vouched) return true;
  if (match.status != MatchResult::Status::kConverged) return false;
  // What fits no better than chance fits badly, whatever went before.
  constexpr double kLeastFit = 0.65;
  if (match.fit() < std::max(kLeastFit, options_.doubtful_fit_ratio * Median(recent_fits_)))
    return false;
  // Without a speed the search does not reach as far as the sensor may have gone.
  const double sigma = std::sqrt(prediction.covariance.diagonal().tail<3>().maxCoeff());
  if (lost_ && !motion_.moving_known() && sigma > options_.search.range_m) return false;
  if (match.overlap() < options_.min_overlap) return false;
  if (gap && WorstSigma(match.covariance) > options_.max_sigma_m) return false;
  return unique();
}

double Odometry::Median(const std::deque<double>& values) {
  if (values.empty()) return 0.0;
  std::vector<double> sorted(values.begin(), values.end());
  std::sort(sorted.begin(), sorted.end());
  return sorted[sorted.size() / 2];
}

void Odometry::Accept(const OdometryFrame& frame) {
  constexpr std::size_t kRecent = 15;
  const bool tracked = frame.status == OdometryFrame::Status::kTracked;
  motion_.Accept(frame.stamp_ns, frame.T_world_lidar, tracked);
  lost_ = false;
  if (tracked) {
    recent_inliers_.push_back(frame.match.inlier_share);
    recent_fits_.push_back(frame.match.fit());
    if (recent_inliers_.size() > kRecent) recent_inliers_.pop_front();
    if (recent_fits_.size() > kRecent) recent_fits_.pop_front();
  } else {
    recent_inliers_.clear();
    recent_fits_.clear();
  }
}

void Odometry::StartAt(const SE3& T_world_lidar) {
  motion_.StartAt(T_world_lidar);
  recent_inliers_.clear();
  recent_fits_.clear();
}

void Odometry::Archive(StateArchive& a) { a(&motion_, &recent_inliers_, &recent_fits_, &lost_); }

}  // namespace lamina
