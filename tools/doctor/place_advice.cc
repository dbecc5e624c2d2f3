#include "tools/doctor/place_advice.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "tools/doctor/place_figures.h"
#include "tools/doctor/place_words.h"
#include "tools/results/verdict/rules.h"

namespace lamina {
namespace {

namespace rules = run_rules;

// With fewer points a scan, voxels of the usual size hold too few of them for planes.
constexpr double kFewPoints = 6000.0;

// Rounded up to half of a unit of its own size: 13 becomes 15.
double RoundUp(double value) {
  const double unit = 0.5 * std::pow(10.0, std::floor(std::log10(value)));
  return unit * std::ceil(value / unit - 1e-9);
}

// Writes the cause of a symptom and what to change into the advice.
class Adviser {
 public:
  Adviser(const RunTable& table, const WeakPlaces& places, const WeakPlace& place,
          PlaceAdvice* advice)
      : table_(table),
        places_(places),
        place_(place),
        config_(table.config),
        figures_(FiguresOf(table, places, place)),
        advice_(advice) {}

  void Advise() {
    switch (place_.symptom) {
      case Symptom::kLost:
        return OfLoss();
      case Symptom::kNewPiece:
        return OfNewPiece();
      case Symptom::kUnconverged:
        return OfUnconverged();
      case Symptom::kSpeedJump:
      case Symptom::kTurnJump:
        return OfJump();
      case Symptom::kDegenerate:
        return OfDegenerate();
      case Symptom::kFewInliers:
        return OfFewInliers();
      case Symptom::kPoorFit:
      case Symptom::kResidual:
        return OfBlur();
      case Symptom::kGap:
        return OfGap();
      case Symptom::kSkipped:
        return OfSkipped();
      case Symptom::kStampBackwards:
        return Say("files come in another order than their stamps, or two scans have one stamp.",
                   {},
                   "Check the clock of the recorder, times.txt, and whether the names of files are "
                   "in the order of time.");
      case Symptom::kOverBudget:
        return OfBudget();
      case Symptom::kSlow:
        return OfSlowness();
    }
  }

 private:
  void Say(std::string cause, std::vector<std::string> settings, std::string record) {
    advice_->cause = std::move(cause);
    advice_->settings = std::move(settings);
    advice_->record = std::move(record);
  }

  bool AfterGap() const { return figures_.interval_s > config_.frontend.vouched_gap_s; }
  bool PointsFell() const { return figures_.points < 0.5 * figures_.points_before; }
  bool FewPoints() const { return figures_.points < kFewPoints; }
  bool TurnsQuickly() const { return figures_.step_deg > 0.5 * config_.frontend.search.range_deg; }
  bool MeetsLittle() const {
    constexpr double kLittleOverlap = 0.25;
    return figures_.overlap < kLittleOverlap;
  }
  bool FarApart() const { return figures_.step_m > config_.map.root_size_m; }

  std::string LargerVoxels() const {
    constexpr double kFactor = 1.5, kLargest = 6.0;
    return fmt::format("map.root_size_m={:.3g}",
                       std::min(kLargest, kFactor * config_.map.root_size_m));
  }
  std::string WiderTurns() const {
    constexpr double kLargest = 60.0;
    return fmt::format("frontend.search.range_deg={:.3g}",
                       std::min(kLargest, 2.0 * config_.frontend.search.range_deg));
  }
  void AddSearch(std::vector<std::string>* settings) const {
    if (!config_.frontend.search.enabled)
      settings->insert(settings->begin(), "frontend.search.enabled=true");
  }

  void OfLoss() {
    const auto& search = config_.frontend.search;
    std::vector<std::string> settings;
    AddSearch(&settings);
    if (AfterGap()) {
      const double way_m = figures_.speed_m_s * figures_.interval_s;
      if (1.2 * way_m > search.max_way_m) {
        settings.push_back(
            fmt::format("frontend.search.max_way_m={:.3g}", std::min(200.0, RoundUp(1.5 * way_m))));
      }
      return Say(
          fmt::format("{:.1f} s without scans come before it{}: the prediction does not reach "
                      "over that.",
                      figures_.interval_s,
                      std::isfinite(way_m)
                          ? fmt::format(", in which the sensor went on by about {:.0f} m", way_m)
                          : ""),
          settings, "Find out why the recorder misses scans: a full disk or a busy computer.");
    }
    if (PointsFell()) {
      return Say(
          fmt::format("usable points fall from {:.0f} to {:.0f} a scan: something covers the "
                      "view (spray, dust, a vehicle beside, a person), or packets are missing.",
                      figures_.points_before, figures_.points),
          settings,
          "Look at these scans; keep the view free. If the vehicle itself is in it, raise "
          "preparation.min_range_m to just above it.");
    }
    if (TurnsQuickly()) {
      settings.push_back(WiderTurns());
      return Say(
          fmt::format("the sensor turns by {:.1f}° from one scan to the next.", figures_.step_deg),
          settings, "Turn more slowly, or record more scans a second.");
    }
    if (MeetsLittle() || (figures_.overlap < 0.5 && figures_.fit > rules::kFit.doubtful)) {
      return Say(
          fmt::format("only {:.0f} % of a scan meets planes of the map: the view is narrow, a "
                      "door or a corner was passed, or nothing lies within preparation."
                      "max_range_m={:g}.",
                      100.0 * figures_.overlap, config_.preparation.max_range_m),
          settings,
          "Let scans that follow one another share half of what they see: go round corners "
          "slowly, and look back.");
    }
    settings.push_back(fmt::format("frontend.search.refined={}", std::min(50, 2 * search.refined)));
    Say("much of a scan meets planes that it does not fit: much moves there, places look alike, or "
        "the motion is not what was predicted.",
        settings,
        "Record again with less traffic around, or start where the surroundings stand still.");
  }

  // Of the scan before it in its recording.
  std::string StatusBefore() const {
    const std::string& sequence = table_.scans[place_.first].record.sequence;
    for (std::size_t i = place_.first; i-- > 0;) {
      if (table_.scans[i].record.sequence == sequence) return table_.scans[i].record.status;
    }
    return "";
  }

  void OfNewPiece() {
    if (AfterGap()) {
      return Say(fmt::format("{:.1f} s without scans come before it, and where they go on nothing "
                             "could be matched to the map.",
                             figures_.interval_s),
                 {}, "Record without a pause, or come back to a place that is in the map already.");
    }
    if (StatusBefore() == "degenerate") {
      return Say(
          fmt::format("scans before it left a direction open, or lie in a place that another one "
                      "explains as well, so that the sensor is known worse than {:g} m "
                      "(backend.restart_after_sigma_m) against what was mapped before.",
                      config_.backend.restart_after_sigma_m),
          {"backend.restart_after_sigma_m=0"},
          "Keep something in view that the map has and that faces the way. 0 keeps one piece, "
          "wrong by what was left open.");
    }
    Say(fmt::format("the sensor stayed lost for {} scans (backend.restart_after_lost_frames), and "
                    "mapping began anew: the place before it is the one to mend.",
                    config_.backend.restart_after_lost_frames),
        {fmt::format("backend.restart_after_lost_frames={}",
                     std::max(40, 2 * config_.backend.restart_after_lost_frames))},
        "Waiting longer helps if the sensor comes back to what it had seen.");
  }

  void OfUnconverged() {
    if (FarApart()) {
      return Say(fmt::format("scans are {:.1f} m apart, more than a voxel of {:.2g} m.",
                             figures_.step_m, config_.map.root_size_m),
                 {LargerVoxels()}, "Record more scans a second, or drive more slowly.");
    }
    if (FewPoints()) {
      return Say(
          fmt::format("a scan has {:.0f} usable points: too few for planes.", figures_.points),
          {LargerVoxels(), "map.min_points=5"}, "");
    }
    if (TurnsQuickly()) {
      return Say(fmt::format("the sensor turns by {:.1f}° from one scan to the next, and the "
                             "prediction is far off.",
                             figures_.step_deg),
                 {"frontend.deskew_passes=3", WiderTurns()}, "Turn more slowly.");
    }
    Say("the match creeps or swings: places look alike, the scans are out of order, or they are "
        "deskewed twice.",
        {fmt::format("frontend.matcher.max_iterations={}",
                     std::min(100, 2 * config_.frontend.matcher.max_iterations))},
        "See whether the names of the files are in the order of time, and what the first three "
        "lines of `lamina run` say on deskewing.");
  }

  // Whether a stamp within the place is not where the ones around make it belong.
  bool StampsStray() const {
    for (std::size_t i = place_.first; i < std::min(place_.last + 2, table_.scans.size()); ++i) {
      const double share = table_.scans[i].interval_s / figures_.usual_interval_s;
      if (share > rules::kGapPeriods || share < 1.0 / rules::kGapPeriods) return true;
    }
    return false;
  }

  void OfJump() {
    if (StampsStray()) {
      return Say(
          "stamps there are not as far apart as the scans were taken: the motion is even, its "
          "times are not; or scans are missing.",
          {}, "Record stamps of the sensor's own clock, not of the arrival at the computer.");
    }
    if (FewPoints()) {
      return Say(fmt::format("with {:.0f} usable points a scan the match slips from one hold to "
                             "another.",
                             figures_.points),
                 {LargerVoxels()}, "");
    }
    Say("the match slipped: what moves pulled the pose along, or places look alike.",
        {"frontend.lost_inlier_ratio=0.5", "frontend.max_prediction_sigmas=3"},
        "Look at the map around the place: doubled walls tell which side of it is wrong.");
  }

  void OfDegenerate() {
    const double limit_m = config_.frontend.max_tracked_sigma_m;
    if (FewPoints()) {
      return Say(fmt::format("with {:.0f} usable points a scan, too little faces that direction.",
                             figures_.points),
                 {LargerVoxels()}, "");
    }
    std::vector<std::string> settings;
    if (place_.worst > limit_m && place_.worst < 2.0 * limit_m) {
      settings.push_back(fmt::format("frontend.max_tracked_sigma_m={:.2g}", 2.0 * limit_m));
    }
    Say("a corridor, a tunnel, an open field, or a wall that fills the view: nothing faces the "
        "direction that stays open, and motion along it is predicted.",
        settings,
        "Poses are as wrong there as constant velocity is. Nothing but another sensor, a wider "
        "view "
        "or a larger preparation.max_range_m helps.");
  }

  void OfFewInliers() {
    if (!MeetsLittle()) return OfBlur();
    if (FarApart()) {
      return Say(fmt::format("scans are {:.1f} m apart: little of one is seen by the next.",
                             figures_.step_m),
                 {LargerVoxels()}, "Record more scans a second, or drive more slowly.");
    }
    if (FewPoints()) {
      return Say(
          fmt::format("a scan has {:.0f} usable points: few voxels hold a plane.", figures_.points),
          {LargerVoxels(), "map.min_points=5"}, "");
    }
    Say(fmt::format("only {:.0f} % of a scan meets planes of the map: foliage and clutter, or "
                    "surroundings that were not seen before.",
                    100.0 * figures_.overlap),
        {LargerVoxels(), fmt::format("map.depth={}", std::min(4, config_.map.depth + 1))}, "");
  }

  void OfBlur() {
    if (config_.preparation.deskew == ScanPreparationOptions::Deskew::kOff) {
      return Say(
          "what meets planes does not fit them, and scans are not deskewed "
          "(preparation.deskew=off): a sweep in motion is bent.",
          {"preparation.deskew=auto"},
          "Record the time of each point; for a spinning sensor without it, "
          "preparation.deskew=azimuth.");
    }
    if (TurnsQuickly()) {
      return Say(
          fmt::format("the sensor turns by {:.1f}° within a scan, and the motion within it is "
                      "not even.",
                      figures_.step_deg),
          {"frontend.deskew_passes=3"}, "Turn more slowly.");
    }
    Say("much moves there, the sensor's angles are badly known, or the map has two copies of one "
        "wall.",
        {},
        "`lamina calibrate` finds angles that are off; for a noisy sensor raise "
        "map.noise_floor_m to its range noise.");
  }

  void OfGap() {
    Say("the recorder dropped scans, or files are missing from the folder.", {},
        "A faster disk or a less busy computer; recordings of the topic alone. Compare the count "
        "of "
        "files with the duration times the rate.");
  }

  void OfSkipped() {
    if (place_.reason == "too_few_points") {
      return Say(
          fmt::format("fewer than {} points are left between {:g} and {:g} m.",
                      config_.pipeline.min_points, config_.preparation.min_range_m,
                      config_.preparation.max_range_m),
          {fmt::format("pipeline.min_points={}", std::max(20, config_.pipeline.min_points / 2))},
          "If the room is small, lower preparation.min_range_m.");
    }
    if (place_.reason == "unreadable") {
      return Say(
          "files there are cut short, damaged or of another format.", {},
          "The log of the run names each file and the rule that it breaks; copy them again.");
    }
    if (place_.reason == "too_soon_after_other_sensor") {
      return Say(
          "two sensors of one vehicle are triggered at once: of scans within 10 ms the later "
          "is left out.",
          {}, "Trigger the sensors half a period apart.");
    }
    if (place_.reason == "no_room_for_piece") {
      return Say("more recordings are under way at once than pipeline.max_recordings.",
                 {fmt::format("pipeline.max_recordings={}", 2 * config_.pipeline.max_recordings)},
                 "");
    }
    Say(fmt::format("status {} in frames.csv.", place_.reason), {}, "");
  }

  void OfBudget() {
    std::vector<std::string> settings;
    if (std::isfinite(place_.worst)) {
      settings.push_back(fmt::format("map.budget_mb={:.0f}", std::ceil(1.1 * place_.worst)));
    }
    Say("the frames of the window alone need more than map.budget_mb.", settings,
        "Or lower backend.window.frames.");
  }

  void OfSlowness() {
    Say("odometry and map take longer than the scans are apart: `watch` would fall behind there. "
        "Searches after a loss take most.",
        {fmt::format("frontend.search.clusters={}",
                     std::max(100, config_.frontend.search.clusters / 2))},
        "Look at the places before it: what is lost is searched for.");
  }

  const RunTable& table_;
  const WeakPlaces& places_;
  const WeakPlace& place_;
  const LaminaConfig& config_;
  const PlaceFigures figures_;
  PlaceAdvice* advice_;
};

}  // namespace

PlaceAdvice Advise(const RunTable& table, const WeakPlaces& places, const WeakPlace& place) {
  PlaceAdvice advice;
  advice.where = DescribeWhere(table, place);
  advice.measured = DescribeFigure(table, places, place);
  Adviser(table, places, place, &advice).Advise();
  return advice;
}

}  // namespace lamina
