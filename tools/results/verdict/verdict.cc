#include "tools/results/verdict/verdict.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>
#include <utility>

#include "backend/mapping/mapped_scan.h"
#include "tools/results/verdict/rules.h"

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

  void MuchOf(std::int64_t part, std::int64_t all, run_rules::Limit limit, const std::string& what,
              const char* hint) {
    // One slip of a short recording is no verdict on it.
    constexpr std::int64_t kFew = 3;
    const double share = Share(part, all);
    Weigh(share >= limit.doubtful, share >= limit.wrong && part >= kFew,
          fmt::format("{:.1f} % {} (from {:.0f} % on that is too much)", 100.0 * share, what,
                      100.0 * limit.doubtful),
          hint);
  }

  void Low(double value, run_rules::Limit limit, const char* what, const char* hint) {
    Weigh(value < limit.doubtful, value < limit.wrong,
          fmt::format("{} {:.2f} (below {:.2f} that is too little)", what, value, limit.doubtful),
          hint);
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

std::optional<RunVerdict> ReadVerdict(const nlohmann::json& summary) {
  using Grade = RunVerdict::Grade;
  try {
    const nlohmann::json& json = summary.at("verdict");
    RunVerdict verdict{Grade::kGood, json.at("reasons"), json.at("hint")};
    const std::string name = json.at("verdict");
    for (const Grade grade : {Grade::kGood, Grade::kDoubtful, Grade::kWrong}) {
      verdict.grade = grade;
      if (ToString(grade) == name) return verdict;
    }
  } catch (const nlohmann::json::exception&) {
    // Another program's, or another version's.
  }
  return std::nullopt;
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

void VerdictCounter::Add(const ScanRecord& scan) {
  if (scan.skipped) {
    // Of two sensors that are triggered together one is enough.
    skipped_ += scan.status == ToString(SkipReason::kTooSoonAfterOtherSensor) ? 0 : 1;
    return last_.clear();
  }
  ++frames_;
  CountPiece(scan);
  if (run_rules::IsLost(scan)) {
    ++lost_;
    return last_.clear();
  }
  degenerate_ += run_rules::IsDegenerate(scan) ? 1 : 0;
  if (run_rules::IsMatched(scan)) {
    ++matched_;
    unconverged_ += run_rules::IsUnconverged(scan, max_iterations_) ? 1 : 0;
    inliers_.Add(scan.inlier_share);
    fits_.Add(run_rules::Fit(scan));
  }
  CountJump(scan);
}

void VerdictCounter::CountPiece(const ScanRecord& scan) {
  pieces_.insert(scan.piece);
  const auto [last, fresh] = piece_of_.try_emplace(scan.sequence, scan.piece);
  // New pieces have greater numbers: it was found where an earlier one, or the map that it is
  // localised in, has been, and goes on with that.
  if (scan.piece < last->second) Join(last->second);
  last->second = scan.piece;
}

void VerdictCounter::CountJump(const ScanRecord& scan) {
  // Steps without recorded stamps tell no speed.
  if (!scan.recorded_stamp) return last_.clear();
  if (last_piece_ != scan.piece) last_.clear();
  last_piece_ = scan.piece;
  const StampedPose pose{scan.stamp_ns, scan.T_world_lidar};
  if (last_.size() == 2) {
    if (const auto change = run_rules::ChangeOfMotion(last_[0], last_[1], pose)) {
      ++motions_;
      jumps_ += change->m_s2 > run_rules::kMostM_S2 ? 1 : 0;
    }
    last_.pop_front();
  }
  last_.push_back(pose);
}

RunVerdict VerdictCounter::Judge() const {
  namespace rules = run_rules;
  constexpr rules::Limit kDegenerate{rules::kDegenerate, std::numeric_limits<double>::infinity()};
  RunVerdict verdict;
  Judgement judgement(&verdict);
  judgement.MuchOf(jumps_, motions_, rules::kJumps,
                   fmt::format("of the motions are more than {:.0f} m/s^2, which no vehicle makes",
                               rules::kMostM_S2),
                   "Check stamps and order of the scans; with few points a scan, raise "
                   "map.root_size_m.");
  judgement.MuchOf(unconverged_, matched_, rules::kUnconverged, "of the matches did not converge",
                   "Try the configuration for this kind of sensor (lamina config), and look at the "
                   "order of the scans.");
  // The first scans meet a map of one or two, and share little with it: that is no verdict.
  constexpr std::int64_t kEnough = 10;
  if (matched_ >= kEnough && !inliers_.empty()) {
    judgement.Low(
        inliers_.Median(), rules::kInliers, "the median share of inliers is",
        "The scans may be too far apart, or map.root_size_m be too large or too small for "
        "the place.");
    judgement.Low(fits_.Median(), rules::kFit, "the median fit on the map's planes is",
                  "A moving sensor without preparation.deskew, or a sensor whose angles are badly "
                  "known (lamina calibrate), blurs the map like that.");
  }
  judgement.MuchOf(lost_, frames_, rules::kLost, "of the scans are lost",
                   "frames.csv says which; frontend.search and preparation.min_range_m matter most "
                   "there.");
  judgement.MuchOf(skipped_, skipped_ + frames_, rules::kSkipped, "of the scans are skipped",
                   "frames.csv says which and why.");
  judgement.MuchOf(degenerate_, frames_, kDegenerate,
                   "of the scans leave a direction open, which is predicted",
                   "Corridors, tunnels and open fields do so, where nothing but another sensor "
                   "helps; so do points without times at speed.");
  const auto pieces = static_cast<std::int64_t>(pieces_.size());
  judgement.Weigh(pieces > 1, false, fmt::format("{} pieces that are not connected", pieces),
                  "Each piece has its own frame and its own map.");
  return verdict;
}

}  // namespace lamina
