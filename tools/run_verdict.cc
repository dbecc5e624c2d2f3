#include "tools/run_verdict.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <utility>

namespace lamina {
namespace {

double Share(std::int64_t part, std::int64_t all) {
  return all > 0 ? static_cast<double>(part) / static_cast<double>(all) : 0.0;
}

// Gathers what speaks against a run.
class Judgement {
 public:
  explicit Judgement(RunVerdict* verdict) : verdict_(verdict) {}

  void Weigh(bool doubtful, bool wrong, std::string reason, const char* hint) {
    if (!doubtful && !wrong) return;
    const RunVerdict::Grade grade =
        wrong ? RunVerdict::Grade::kWrong : RunVerdict::Grade::kDoubtful;
    // What weighs most is said first, with its hint.
    const bool worse = grade > verdict_->grade;
    verdict_->grade = std::max(grade, verdict_->grade);
    auto& reasons = verdict_->reasons;
    reasons.insert(worse ? reasons.begin() : reasons.end(), std::move(reason));
    if (worse || verdict_->hint.empty()) verdict_->hint = hint;
  }

  void MuchOf(std::int64_t part, std::int64_t all, double doubtful, double wrong, const char* what,
              const char* hint) {
    // One slip of a short recording is no verdict on it.
    constexpr std::int64_t kFew = 3;
    const double share = Share(part, all);
    Weigh(share >= doubtful, share >= wrong && part >= kFew,
          fmt::format("{:.1f} % {} (from {:.0f} % on that is too much)", 100.0 * share, what,
                      100.0 * doubtful),
          hint);
  }

  void Low(double value, double doubtful, double wrong, const char* what, const char* hint) {
    Weigh(value < doubtful, value < wrong,
          fmt::format("{} {:.2f} (below {:.2f} that is too little)", what, value, doubtful), hint);
  }

 private:
  RunVerdict* verdict_;
};

}  // namespace

std::string ToString(RunVerdict::Grade grade) {
  switch (grade) {
    case RunVerdict::Grade::kGood:
      return "good";
    case RunVerdict::Grade::kDoubtful:
      return "doubtful";
    case RunVerdict::Grade::kWrong:
      return "wrong";
  }
  return "";
}

std::string ToString(const RunVerdict& verdict) {
  std::string text = ToString(verdict.grade);
  if (verdict.reasons.empty()) return text;
  return fmt::format("{}: {}. {}", text, fmt::join(verdict.reasons, "; "), verdict.hint);
}

nlohmann::json ToJson(const RunVerdict& verdict) {
  return {
      {"verdict", ToString(verdict.grade)}, {"reasons", verdict.reasons}, {"hint", verdict.hint}};
}

void ShareHistogram::Add(double share) {
  const double last = static_cast<double>(counts_.size() - 1);
  ++counts_[static_cast<std::size_t>(std::lround(last * std::clamp(share, 0.0, 1.0)))];
  ++all_;
}

double ShareHistogram::Median() const {
  std::size_t i = 0;
  for (std::int64_t below = counts_[0]; 2 * below < all_; below += counts_[i]) ++i;
  return static_cast<double>(i) / static_cast<double>(counts_.size() - 1);
}

void VerdictCounter::Add(const SessionScan& scan) {
  if (scan.skipped) return last_.clear();
  ++frames_;
  pieces_.insert(scan.piece);
  if (scan.status == "lost") {
    ++lost_;
    return last_.clear();
  }
  degenerate_ += scan.status == "degenerate" ? 1 : 0;
  if (scan.matched > 0) {
    ++matched_;
    unconverged_ += scan.iterations >= max_iterations_ ? 1 : 0;
    inliers_.Add(scan.inlier_share);
    fits_.Add(scan.inlier_share * static_cast<double>(scan.clusters) /
              static_cast<double>(scan.matched));
  }
  CountJump(scan);
}

void VerdictCounter::CountJump(const SessionScan& scan) {
  // Beyond what brakes, tyres and arms can do, and the error that poses may have.
  constexpr double kMostM_S2 = 30.0, kPoseErrorM = 0.05;
  // Steps that nobody timed tell no speed.
  if (!scan.recorded_stamp) return last_.clear();
  if (!last_.empty() && last_.back().piece != scan.piece) last_.clear();
  if (last_.size() == 2) {
    const double before_s = SecondsBetween(last_[0].stamp_ns, last_[1].stamp_ns);
    const double after_s = SecondsBetween(last_[1].stamp_ns, scan.stamp_ns);
    if (before_s > 0.0 && after_s > 0.0) {
      const Eigen::Vector3d before =
          (last_[1].T_world_lidar.t - last_[0].T_world_lidar.t) / before_s;
      const Eigen::Vector3d after = (scan.T_world_lidar.t - last_[1].T_world_lidar.t) / after_s;
      const double dt = 0.5 * (before_s + after_s);
      ++motions_;
      jumps_ += (after - before).norm() * dt > kMostM_S2 * dt * dt + kPoseErrorM ? 1 : 0;
    }
    last_.pop_front();
  }
  last_.push_back({scan.piece, scan.stamp_ns, scan.T_world_lidar});
}

RunVerdict VerdictCounter::Judge() const {
  RunVerdict verdict;
  Judgement judgement(&verdict);
  judgement.MuchOf(jumps_, motions_, 0.01, 0.04,
                   "of the motions are more than 30 m/s^2, which no vehicle makes",
                   "Check stamps and order of the scans; with few points a scan, raise "
                   "map.root_size_m.");
  judgement.MuchOf(unconverged_, matched_, 0.08, 0.15, "of the matches did not converge",
                   "Try the configuration for this kind of sensor (lamina config), and look at the "
                   "order of the scans.");
  if (!inliers_.empty()) {
    judgement.Low(
        inliers_.Median(), 0.30, 0.20, "the median share of inliers is",
        "The scans may be too far apart, or map.root_size_m be too large or too small for "
        "the place.");
    judgement.Low(fits_.Median(), 0.75, 0.60, "the median fit on the map's planes is",
                  "A moving sensor without preparation.deskew, or a sensor whose angles are badly "
                  "known (lamina calibrate), blurs the map like that.");
  }
  judgement.MuchOf(lost_, frames_, 0.05, 0.50, "of the scans are lost",
                   "frames.csv says which; frontend.search and preparation.min_range_m matter most "
                   "there.");
  judgement.MuchOf(degenerate_, frames_, 0.25, 2.0,
                   "of the scans leave a direction open, which is predicted",
                   "Corridors, tunnels and open fields do so; nothing but another sensor helps.");
  const auto pieces = static_cast<std::int64_t>(pieces_.size());
  judgement.Weigh(pieces > 1, false, fmt::format("{} pieces that are not connected", pieces),
                  "Each piece has its own frame and its own map.");
  return verdict;
}

}  // namespace lamina
