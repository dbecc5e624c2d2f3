#include "tools/doctor/place_figures.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "core/base/angle.h"
#include "core/base/median.h"
#include "tools/results/verdict/rules.h"

namespace lamina {
namespace {

namespace rules = run_rules;

// Medians of what a figure is over scans [begin, end) that have it.
template <typename Figure>
double MedianOver(const RunTable& table, std::size_t begin, std::size_t end, Figure figure) {
  std::vector<double> values;
  for (std::size_t i = begin; i < end; ++i) {
    const double value = figure(table.scans[i].record);
    if (std::isfinite(value)) values.push_back(value);
  }
  return Median(std::move(values));
}

// Motion between the two scans with sound poses that come last before the place, or first in it.
void AddMotion(const RunTable& table, const WeakPlace& place, PlaceFigures* figures) {
  const RunScan* later = nullptr;
  const std::int64_t piece = table.scans[place.first].record.piece;
  for (std::size_t i = place.last + 1; i-- > 0;) {
    const RunScan& scan = table.scans[i];
    if (!scan.has_pose || rules::IsLost(scan.record) || scan.record.piece != piece) continue;
    if (later != nullptr) {
      const SE3 &a = scan.record.T_world_lidar, &b = later->record.T_world_lidar;
      const double dt_s = SecondsBetween(scan.record.stamp_ns, later->record.stamp_ns);
      figures->step_m = (b.t - a.t).norm();
      figures->step_deg = Degrees(LogSO3(a.q.conjugate() * b.q).norm());
      if (dt_s > 0.0) figures->speed_m_s = figures->step_m / dt_s;
      if (i < place.first) return;
    }
    later = &scan;
  }
}

}  // namespace

PlaceFigures FiguresOf(const RunTable& table, const WeakPlaces& places, const WeakPlace& place) {
  constexpr std::size_t kBefore = 20;
  PlaceFigures figures;
  figures.interval_s = table.scans[place.first].interval_s;
  figures.usual_interval_s = places.UsualIntervalAt(place.first);
  AddMotion(table, place, &figures);
  const auto points = [](const ScanRecord& scan) {
    return scan.skipped || scan.points == 0 ? kUnknown : static_cast<double>(scan.points);
  };
  const std::size_t before = place.first - std::min(place.first, kBefore);
  figures.points = MedianOver(table, place.first, place.last + 1, points);
  figures.points_before = MedianOver(table, before, place.first, points);
  figures.overlap = MedianOver(table, place.first, place.last + 1, [](const ScanRecord& scan) {
    return scan.skipped || scan.clusters == 0 ? kUnknown : rules::Overlap(scan);
  });
  figures.fit = MedianOver(table, place.first, place.last + 1, [](const ScanRecord& scan) {
    return scan.skipped || scan.matched == 0 ? kUnknown : rules::Fit(scan);
  });
  return figures;
}

}  // namespace lamina
