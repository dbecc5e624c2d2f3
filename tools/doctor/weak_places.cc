#include "tools/doctor/weak_places.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <stdexcept>

#include "tools/results/verdict/rules.h"

namespace lamina {
namespace {

namespace rules = run_rules;

// Scans without the symptom that may lie within one place.
constexpr std::size_t kMergedOver = 5;

// Scans of a piece whose map is still of one or two scans: little of a scan meets it.
constexpr int kYoungScans = 2;

bool SequenceGoesBack(const ScanRecord& scan) { return scan.status == "stamp_not_after_last"; }

// What odometry and map take, which is done for one scan after the other.
double SerialMs(const ScanRecord& scan) { return scan.odometry_ms + scan.map_ms; }

struct Limits {
  double value;
  bool low_is_bad;
};

// NaN where the scan's status tells.
Limits LimitOf(Symptom symptom, const LaminaConfig& config) {
  switch (symptom) {
    case Symptom::kLost:
      return {kUnknown, true};
    case Symptom::kFewInliers:
      return {rules::kInliers.wrong, true};
    case Symptom::kPoorFit:
      return {rules::kFit.wrong, true};
    case Symptom::kUnconverged:
      return {static_cast<double>(config.frontend.matcher.max_iterations), false};
    case Symptom::kSpeedJump:
      return {rules::kMostM_S2, false};
    case Symptom::kTurnJump:
      return {rules::kMostDeg_S2, false};
    case Symptom::kDegenerate:
      return {config.frontend.max_tracked_sigma_m, false};
    case Symptom::kResidual:
      return {rules::kMostResidualFloors * config.map.noise_floor_m, false};
    case Symptom::kOverBudget:
      return {static_cast<double>(config.map.budget_mb), false};
    case Symptom::kSkipped:
      return {static_cast<double>(config.pipeline.min_points), true};
    case Symptom::kNewPiece:
    case Symptom::kGap:
    case Symptom::kStampBackwards:
    case Symptom::kSlow:
      break;
  }
  return {kUnknown, false};
}

}  // namespace

const std::vector<SymptomKind>& SymptomKinds() {
  static const std::vector<SymptomKind> kinds{
      {Symptom::kLost, "lost", "share of inliers", "", 100.0},
      {Symptom::kNewPiece, "a new piece of the map", "time since the scan before", "s", 80.0},
      {Symptom::kUnconverged, "matches that did not converge", "steps of the matcher", "", 50.0},
      {Symptom::kSpeedJump, "a jump of speed", "acceleration", "m/s²", 40.0},
      {Symptom::kTurnJump, "a jump of the turn", "acceleration of the turn", "°/s²", 38.0},
      {Symptom::kDegenerate, "a direction that nothing determines", "largest standard deviation",
       "m", 20.0},
      {Symptom::kFewInliers, "few inliers", "share of inliers", "", 15.0},
      {Symptom::kPoorFit, "a poor fit", "fit of what meets planes", "", 14.0},
      {Symptom::kResidual, "large residuals", "residual", "m", 10.0},
      {Symptom::kGap, "scans that are missing", "time since the scan before", "s", 6.0},
      {Symptom::kSkipped, "skipped scans", "usable points", "", 4.0},
      {Symptom::kStampBackwards, "stamps that go backwards", "time since the scan before", "s",
       3.0},
      {Symptom::kOverBudget, "a map over its budget", "", "MB", 2.0},
      {Symptom::kSlow, "slower than the sensor", "odometry and map", "ms", 1.0},
  };
  return kinds;
}

const SymptomKind& KindOf(Symptom symptom) {
  for (const SymptomKind& kind : SymptomKinds()) {
    if (kind.symptom == symptom) return kind;
  }
  throw std::logic_error("a symptom without a kind");
}

WeakPlaces::WeakPlaces(const RunTable& table)
    : table_(table),
      speed_change_(table.scans.size(), kUnknown),
      turn_change_(table.scans.size(), kUnknown),
      begins_piece_(table.scans.size()),
      young_(table.scans.size()) {
  for (const RunScan& scan : table.scans) {
    const std::string& sequence = scan.record.sequence;
    if (usual_interval_s_.count(sequence) == 0) {
      const double usual_s = usual_interval_s_[sequence] = UsualInterval(table, sequence);
      gap_s_[sequence] = usual_s * (HasEvenIntervals(table, sequence) ? rules::kGapPeriods
                                                                      : rules::kUnevenGapPeriods);
    }
  }
  FindMotions();
  FindNewPieces();
  for (const SymptomKind& kind : SymptomKinds()) {
    if (kind.symptom != Symptom::kOverBudget) FindPlaces(kind.symptom);
  }
  AddOverBudget();
  std::stable_sort(places_.begin(), places_.end(), [](const WeakPlace& a, const WeakPlace& b) {
    return a.harm != b.harm ? a.harm > b.harm : a.first < b.first;
  });
}

// The scan in the middle of three is the one that jumps.
void WeakPlaces::FindMotions() {
  std::map<std::int64_t, std::vector<std::size_t>> last;  // by piece, at most two
  for (std::size_t i = 0; i < table_.scans.size(); ++i) {
    const RunScan& scan = table_.scans[i];
    std::vector<std::size_t>& chain = last[scan.record.piece];
    // Steps without recorded stamps tell no speed.
    if (!scan.has_pose || rules::IsLost(scan.record) || !scan.record.recorded_stamp) {
      chain.clear();
      continue;
    }
    const auto pose = [&](std::size_t at) {
      const ScanRecord& record = table_.scans[at].record;
      return StampedPose{record.stamp_ns, record.T_world_lidar};
    };
    if (chain.size() == 2) {
      if (const auto change = rules::ChangeOfMotion(pose(chain[0]), pose(chain[1]), pose(i))) {
        speed_change_[chain[1]] = change->m_s2;
        turn_change_[chain[1]] = change->deg_s2;
      }
      chain.erase(chain.begin());
    }
    chain.push_back(i);
  }
}

// A recording's first piece is none that anything could have connected; and one with a smaller
// number is an older piece, or a map, in which the sensor was found.
void WeakPlaces::FindNewPieces() {
  std::map<std::int64_t, int> matched;            // by piece
  std::map<std::string, std::int64_t> newest_of;  // piece, by recording
  for (std::size_t i = 0; i < table_.scans.size(); ++i) {
    const ScanRecord& scan = table_.scans[i].record;
    if (scan.skipped) continue;
    const auto [at, fresh] = matched.try_emplace(scan.piece, 0);
    const auto [newest, first] = newest_of.try_emplace(scan.sequence, scan.piece);
    begins_piece_[i] = fresh && !first && scan.piece > newest->second;
    newest->second = std::max(newest->second, scan.piece);
    if (rules::IsMatched(scan)) young_[i] = ++at->second <= kYoungScans;
  }
}

double WeakPlaces::UsualIntervalAt(std::size_t i) const {
  return usual_interval_s_.at(table_.scans[i].record.sequence);
}

double WeakPlaces::FigureOf(Symptom symptom, std::size_t i) const {
  const RunScan& scan = table_.scans[i];
  const ScanRecord& record = scan.record;
  const bool matched = rules::IsMatched(record);
  switch (symptom) {
    case Symptom::kLost:
      return record.skipped || record.matched == 0 ? kUnknown : record.inlier_share;
    case Symptom::kFewInliers:
      return matched ? record.inlier_share : kUnknown;
    case Symptom::kPoorFit:
      return matched ? rules::Fit(record) : kUnknown;
    case Symptom::kUnconverged:
      return matched ? static_cast<double>(record.iterations) : kUnknown;
    case Symptom::kSpeedJump:
      return speed_change_[i];
    case Symptom::kTurnJump:
      return turn_change_[i];
    case Symptom::kDegenerate:
      return matched ? record.worst_sigma_m : kUnknown;
    case Symptom::kResidual:
      return matched ? record.residual_m : kUnknown;
    case Symptom::kNewPiece:
    case Symptom::kGap:
    case Symptom::kStampBackwards:
      return scan.interval_s;
    case Symptom::kSkipped:
      return static_cast<double>(record.points);
    case Symptom::kSlow:
      return record.skipped ? kUnknown : SerialMs(record);
    case Symptom::kOverBudget:
      break;
  }
  return kUnknown;
}

bool WeakPlaces::Shows(Symptom symptom, std::size_t i) const {
  const ScanRecord& scan = table_.scans[i].record;
  const double figure = FigureOf(symptom, i);
  switch (symptom) {
    case Symptom::kLost:
      return rules::IsLost(scan);
    case Symptom::kNewPiece:
      return begins_piece_[i];
    case Symptom::kUnconverged:
      return rules::IsUnconverged(scan, table_.config.frontend.matcher.max_iterations);
    case Symptom::kDegenerate:
      return rules::IsDegenerate(scan);
    case Symptom::kSkipped:
      return scan.skipped && !SequenceGoesBack(scan);
    case Symptom::kStampBackwards:
      return SequenceGoesBack(scan);
    case Symptom::kGap:
      return figure > gap_s_.at(table_.scans[i].record.sequence);
    case Symptom::kSlow:
      return figure > 1e3 * UsualIntervalAt(i);
    case Symptom::kOverBudget:
      return false;
    case Symptom::kFewInliers:
    case Symptom::kPoorFit:
      if (young_[i]) return false;
      break;
    case Symptom::kSpeedJump:
    case Symptom::kTurnJump:
    case Symptom::kResidual:
      break;
  }
  // Comparisons with NaN are false.
  const Limits limit = LimitOf(symptom, table_.config);
  return limit.low_is_bad ? figure < limit.value : figure > limit.value;
}

SymptomFigures WeakPlaces::Figures(Symptom symptom) const {
  const Limits limit = LimitOf(symptom, table_.config);
  SymptomFigures figures{{}, limit.value, limit.low_is_bad};
  for (std::size_t i = 0; i < table_.scans.size(); ++i) {
    figures.values.push_back(FigureOf(symptom, i));
  }
  return figures;
}

double WeakPlaces::MissingBefore(std::size_t i) const {
  return std::max(1.0, std::round(table_.scans[i].interval_s / UsualIntervalAt(i)) - 1.0);
}

double WeakPlaces::ExtentOf(Symptom symptom, std::size_t i) const {
  if (symptom != Symptom::kGap) return 1.0;
  // What a long gap does to the poses, other symptoms tell.
  constexpr double kMostMissing = 25.0;
  return std::min(MissingBefore(i), kMostMissing);
}

void WeakPlaces::FindPlaces(Symptom symptom) {
  std::vector<WeakPlace> found;
  std::map<std::string, std::size_t> open;  // by reason
  const bool low = LimitOf(symptom, table_.config).low_is_bad;
  for (std::size_t i = 0; i < table_.scans.size(); ++i) {
    if (!Shows(symptom, i)) continue;
    const std::string reason =
        symptom == Symptom::kSkipped ? table_.scans[i].record.status : std::string();
    const auto at = open.find(reason);
    if (at == open.end() || i - found[at->second].last > kMergedOver + 1) {
      open[reason] = found.size();
      WeakPlace fresh;
      fresh.symptom = symptom;
      fresh.first = fresh.worst_at = i;
      fresh.worst = kUnknown;
      fresh.reason = reason;
      found.push_back(fresh);
    }
    WeakPlace& place = found[open.at(reason)];
    place.last = i;
    ++place.count;
    place.extent += ExtentOf(symptom, i);
    const double figure = FigureOf(symptom, i);
    if (std::isnan(place.worst) || (low ? figure < place.worst : figure > place.worst)) {
      place.worst = figure;
      place.worst_at = i;
    }
  }
  for (WeakPlace& place : found) {
    place.harm = KindOf(symptom).weight * std::sqrt(place.extent);
    if (symptom == Symptom::kSlow) {
      double behind_s = 0.0;
      for (std::size_t i = place.first; i <= place.last; ++i) {
        if (Shows(symptom, i)) behind_s += 1e-3 * FigureOf(symptom, i) - UsualIntervalAt(i);
      }
      if (behind_s < rules::kMostBehindS) continue;
    }
    places_.push_back(place);
  }
}

// Not of a scan: summary.json tells it of the run.
void WeakPlaces::AddOverBudget() {
  const nlohmann::json& summary = table_.summary;
  const auto over = summary.find("map_over_budget");
  if (over == summary.end() || *over != true) return;
  WeakPlace place;
  place.symptom = Symptom::kOverBudget;
  place.last = table_.scans.size() - 1;
  place.count = table_.scans.size();
  place.extent = 1.0;
  const auto peak = summary.find("map_peak_bytes");
  const bool known = peak != summary.end() && peak->is_number();
  place.worst = known ? peak->get<double>() / 1048576.0 : kUnknown;
  place.harm = KindOf(place.symptom).weight;
  places_.push_back(place);
}

}  // namespace lamina
