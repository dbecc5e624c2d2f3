#include "frontend/odometry.h"

#include <algorithm>
#include <cmath>

#include "core/parallel.h"

namespace lamina {
namespace {

// Steps of a grid to either side of its middle.
int StepsIn(double range, double step) { return static_cast<int>(std::floor(range / step + 1e-9)); }

}  // namespace

void OdometryOptions::Visit(OptionVisitor& v) {
  v.Integer("deskew_passes", &deskew_passes, 0, 10);
  v.Number("max_prediction_gap_s", &max_prediction_gap_s, 0.0, 1e6);
  v.Number("lost_inlier_ratio", &lost_inlier_ratio, 0.0, 1.0);
  v.Group("matcher", &matcher);
  v.Group("search", &search);
}

void PoseSearchOptions::Visit(OptionVisitor& v) {
  v.Flag("enabled", &enabled);
  v.Number("trigger_rotation_deg", &trigger_rotation_deg, 0.0, 180.0);
  v.Number("trigger_translation_m", &trigger_translation_m, 0.0, 1e3);
  v.Number("trigger_inlier_ratio", &trigger_inlier_ratio, 0.0, 10.0);
  v.Number("range_deg", &range_deg, 0.0, 60.0);
  v.Number("step_deg", &step_deg, 0.5, 60.0);
  v.Number("range_m", &range_m, 0.0, 20.0);
  v.Number("step_m", &step_m, 0.05, 20.0);
  v.Integer("clusters", &clusters, 10, 100000);
  v.Number("score_scale_m", &score_scale_m, 0.001, 10.0);
  v.Integer("refined", &refined, 1, 1000);
}

Odometry::Odometry(const OdometryOptions& options) : options_(options), matcher_(options.matcher) {
  CheckOptions(options, "frontend");
}

std::optional<double> Odometry::KnownGap(StampNs stamp_ns) const {
  const double dt = SecondsBetween(last_stamp_ns_, stamp_ns);
  if (interrupted_ || dt <= 0.0 || dt > options_.max_prediction_gap_s) return std::nullopt;
  return dt;
}

SE3 Odometry::Predict(StampNs stamp_ns) const {
  const std::optional<double> dt = KnownGap(stamp_ns);
  return dt ? T_world_last_ * TwistExp(velocity_ * *dt) : T_world_last_;
}

OdometryFrame Odometry::Register(StampNs stamp_ns, const std::vector<TimedCluster>& clusters,
                                 const VoxelMap& map, bool map_is_older) const {
  OdometryFrame frame;
  frame.stamp_ns = stamp_ns;
  if (!started_) return frame;
  const std::optional<double> dt = KnownGap(stamp_ns);
  if (dt) frame.twist = velocity_;
  frame.T_world_predicted = Predict(stamp_ns);
  const std::vector<PointCluster> deskewed = DeskewClusters(clusters, frame.twist);
  frame.match = matcher_.Match(deskewed, frame.T_world_predicted, map);
  // The first match has no speed, and the second none yet.
  if (map_is_older && recent_inliers_.size() < 2) {
    frame.searched = true;
    frame.match = Search(deskewed, OffsetsAbout(frame.T_world_predicted), frame.match, map);
  }
  if (NeedsSearch(frame)) {
    frame.searched = true;
    frame.match =
        Search(deskewed, TurnsAbout({frame.T_world_predicted, T_world_last_}), frame.match, map);
  }
  const bool timed = AnyTimed(clusters);
  for (int pass = 0; timed && dt && pass < options_.deskew_passes; ++pass) {
    frame.twist = TwistLog(T_world_last_.Inverse() * frame.match.T_world_lidar) / *dt;
    frame.match =
        matcher_.Match(DeskewClusters(clusters, frame.twist), frame.match.T_world_lidar, map);
  }
  frame.T_world_lidar = frame.match.T_world_lidar;
  frame.status = OdometryFrame::Status::kTracked;
  if (frame.match.status == MatchResult::Status::kTooFewMatches ||
      frame.match.inlier_share < options_.lost_inlier_ratio * RecentInliers()) {
    frame.status = OdometryFrame::Status::kLost;
    frame.T_world_lidar = frame.T_world_predicted;
  }
  return frame;
}

bool Odometry::NeedsSearch(const OdometryFrame& frame) const {
  const PoseSearchOptions& o = options_.search;
  if (!o.enabled) return false;
  if (frame.match.status == MatchResult::Status::kTooFewMatches) return true;
  const SE3& a = frame.T_world_predicted;
  const SE3& b = frame.match.T_world_lidar;
  if (RotationAngle(a, b) > o.trigger_rotation_deg * M_PI / 180.0) return true;
  if ((a.t - b.t).norm() > o.trigger_translation_m) return true;
  return frame.match.inlier_share < o.trigger_inlier_ratio * RecentInliers();
}

double Odometry::RecentInliers() const {
  if (recent_inliers_.empty()) return 0.0;
  std::vector<double> sorted(recent_inliers_.begin(), recent_inliers_.end());
  std::sort(sorted.begin(), sorted.end());
  return sorted[sorted.size() / 2];
}

std::vector<SE3> Odometry::TurnsAbout(const std::vector<SE3>& centres) const {
  const PoseSearchOptions& o = options_.search;
  const int steps = StepsIn(o.range_deg, o.step_deg);
  std::vector<SE3> hypotheses;
  for (const SE3& centre : centres) {
    for (int x = -steps; x <= steps; ++x) {
      for (int y = -steps; y <= steps; ++y) {
        for (int z = -steps; z <= steps; ++z) {
          const Eigen::Vector3d w = o.step_deg * M_PI / 180.0 * Eigen::Vector3d(x, y, z);
          hypotheses.emplace_back(centre.q * ExpSO3(w), centre.t);
        }
      }
    }
  }
  return hypotheses;
}

std::vector<SE3> Odometry::OffsetsAbout(const SE3& centre) const {
  const PoseSearchOptions& o = options_.search;
  const int steps = StepsIn(o.range_m, o.step_m);
  std::vector<SE3> hypotheses;
  for (int x = -steps; x <= steps; ++x) {
    for (int y = -steps; y <= steps; ++y) {
      hypotheses.emplace_back(centre.q, centre * Eigen::Vector3d(o.step_m * x, o.step_m * y, 0.0));
    }
  }
  return hypotheses;
}

MatchResult Odometry::Search(const std::vector<PointCluster>& clusters,
                             const std::vector<SE3>& hypotheses, const MatchResult& given,
                             const VoxelMap& map) const {
  const PoseSearchOptions& o = options_.search;
  const std::size_t stride =
      std::max<std::size_t>(1, clusters.size() / static_cast<std::size_t>(o.clusters));
  std::vector<std::pair<double, std::size_t>> scores(hypotheses.size());
  ParallelChunks(hypotheses.size(), 16, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      scores[i] = {-matcher_.Score(clusters, hypotheses[i], map, o.score_scale_m, stride), i};
    }
  });
  const std::size_t refined = std::min(scores.size(), static_cast<std::size_t>(o.refined));
  std::partial_sort(scores.begin(), scores.begin() + static_cast<std::ptrdiff_t>(refined),
                    scores.end());
  std::vector<MatchResult> results(refined);
  ParallelChunks(refined, 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      results[i] = matcher_.Match(clusters, hypotheses[scores[i].second], map);
    }
  });
  MatchResult best = given;
  for (const MatchResult& r : results) {
    if (r.status != MatchResult::Status::kTooFewMatches && r.inlier_share > best.inlier_share)
      best = r;
  }
  return best;
}

void Odometry::Accept(const OdometryFrame& frame) {
  constexpr std::size_t kRecent = 15;
  const double dt = SecondsBetween(last_stamp_ns_, frame.stamp_ns);
  velocity_.setZero();
  if (frame.status == OdometryFrame::Status::kTracked) {
    if (dt > 0.0 && !interrupted_) {
      velocity_ = TwistLog(T_world_last_.Inverse() * frame.T_world_lidar) / dt;
    }
    recent_inliers_.push_back(frame.match.inlier_share);
    if (recent_inliers_.size() > kRecent) recent_inliers_.pop_front();
  } else {
    recent_inliers_.clear();
  }
  last_stamp_ns_ = frame.stamp_ns;
  T_world_last_ = frame.T_world_lidar;
  started_ = true;
  interrupted_ = false;
}

void Odometry::StartAt(const SE3& T_world_lidar) {
  T_world_last_ = T_world_lidar;
  velocity_.setZero();
  recent_inliers_.clear();
  started_ = interrupted_ = true;
}

void Odometry::Archive(StateArchive& a) {
  a(&recent_inliers_, &started_, &interrupted_, &last_stamp_ns_, &T_world_last_, &velocity_);
}

void Odometry::Correct(const SE3& correction) { T_world_last_ = correction * T_world_last_; }

}  // namespace lamina
