#include "tools/doctor/place_words.h"

#include <fmt/format.h>

#include <cmath>

namespace lamina {
namespace {

std::string FormatFigure(double value, const SymptomKind& kind) {
  if (!std::isfinite(value)) return "unknown";
  std::string text =
      std::abs(value) >= 100.0 ? fmt::format("{:.0f}", value) : fmt::format("{:.3g}", value);
  if (kind.unit[0] != '\0') text += fmt::format(" {}", kind.unit);
  return text;
}

// What ends a loss.
std::string HowItWentOn(const RunTable& table, const WeakPlace& place) {
  for (std::size_t i = place.last + 1; i < table.scans.size(); ++i) {
    const ScanRecord& scan = table.scans[i].record;
    if (scan.skipped) continue;
    if (scan.piece != table.scans[place.last].record.piece) {
      return fmt::format("; piece {} begins at scan {}", scan.piece, scan.scan);
    }
    return fmt::format("; found again at scan {}", scan.scan);
  }
  return "; not found again until the end";
}

double MissingScans(const WeakPlaces& places, const WeakPlace& place) {
  double missing = 0.0;
  for (std::size_t i = place.first; i <= place.last; ++i) {
    if (places.Shows(Symptom::kGap, i)) missing += places.MissingBefore(i);
  }
  return missing;
}

}  // namespace

std::string NameScans(const RunTable& table, const WeakPlace& place) {
  const std::int64_t first = table.scans[place.first].record.scan;
  const std::int64_t last = table.scans[place.last].record.scan;
  return first == last ? fmt::format("scan {}", first) : fmt::format("scans {} to {}", first, last);
}

std::string DescribeWhere(const RunTable& table, const WeakPlace& place) {
  const RunScan &first = table.scans[place.first], &last = table.scans[place.last];
  std::string text = NameScans(table, place);
  const RunScan& start = table.scans.front();
  if (first.has_stamp && last.has_stamp && start.has_stamp) {
    const auto at = [&](const RunScan& scan) {
      return SecondsBetween(start.record.stamp_ns, scan.record.stamp_ns);
    };
    text += place.first == place.last ? fmt::format(", at {:.1f} s", at(first))
                                      : fmt::format(", {:.1f} to {:.1f} s", at(first), at(last));
  }
  // Where scans have no pose, the last one before.
  for (std::size_t i = place.first + 1; i-- > 0;) {
    const RunScan& scan = table.scans[i];
    if (scan.record.piece != first.record.piece) break;
    if (!std::isfinite(scan.way_m)) continue;
    text += fmt::format(", {:.1f} m along the way", scan.way_m);
    break;
  }
  if (first.record.piece != 0) text += fmt::format(" of piece {}", first.record.piece);
  return text;
}

std::string DescribeFigure(const RunTable& table, const WeakPlaces& places,
                           const WeakPlace& place) {
  const SymptomKind& kind = KindOf(place.symptom);
  const std::string worst = FormatFigure(place.worst, kind);
  const std::int64_t at = table.scans[place.worst_at].record.scan;
  const double usual_s = places.UsualIntervalAt(place.first);
  switch (place.symptom) {
    case Symptom::kLost:
      return fmt::format("{} of {} scans lost, {} {} at the least{}", place.count,
                         place.last - place.first + 1, kind.figure, worst,
                         HowItWentOn(table, place));
    case Symptom::kNewPiece:
      return fmt::format("piece {} begins; no match connects it to the ones before",
                         table.scans[place.first].record.piece);
    case Symptom::kUnconverged:
      return fmt::format("{} matches stop at {} steps (frontend.matcher.max_iterations)",
                         place.count, table.config.frontend.matcher.max_iterations);
    case Symptom::kDegenerate:
      return fmt::format("{} scans, {} up to {} at scan {} (frontend.max_tracked_sigma_m={:g})",
                         place.count, kind.figure, worst, at,
                         table.config.frontend.max_tracked_sigma_m);
    case Symptom::kGap:
      return fmt::format("{} to the scan before, where {:.3g} s are usual: about {:.0f} missing",
                         worst, usual_s, MissingScans(places, place));
    case Symptom::kSkipped:
      return fmt::format("{} skipped: {}", place.count, place.reason);
    case Symptom::kStampBackwards:
      return fmt::format("{} skipped, up to {:.3g} s before the newest stamp", place.count,
                         -place.worst);
    case Symptom::kOverBudget:
      return fmt::format("the map takes up to {} of map.budget_mb={:g}", worst,
                         static_cast<double>(table.config.map.budget_mb));
    case Symptom::kSlow:
      return fmt::format("{} scans take longer than the {:.0f} ms between them, scan {} {}",
                         place.count, 1e3 * usual_s, at, worst);
    case Symptom::kSpeedJump:
    case Symptom::kTurnJump:
    case Symptom::kFewInliers:
    case Symptom::kPoorFit:
    case Symptom::kResidual:
      break;
  }
  const SymptomFigures figures = places.Figures(place.symptom);
  return fmt::format("{} {} at scan {}, {} {} is too {}", kind.figure, worst, at,
                     figures.low_is_bad ? "below" : "above", FormatFigure(figures.limit, kind),
                     figures.low_is_bad ? "little" : "much");
}

}  // namespace lamina
