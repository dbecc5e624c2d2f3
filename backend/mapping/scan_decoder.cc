#include "backend/mapping/scan_decoder.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "core/base/error.h"
#include "core/base/median.h"
#include "core/base/stopwatch.h"
#include "frontend/scan/scan_clusters.h"

namespace lamina {
namespace {

std::vector<StampNs> StampsAt(const ScanSource& source, std::size_t begin, std::size_t i) {
  std::vector<StampNs> stamps = source.StampsUpTo(i, begin, kPeriodStamps);
  // The first scan knows no period yet, but the next stamp is there to see.
  if (stamps.size() == 1) {
    if (const auto after = source.StampAfter(i)) stamps.push_back(*after);
  }
  return stamps;
}

double PeriodByStamps(const std::vector<StampNs>& stamps) {
  constexpr double kFallbackS = 0.1;
  return SweepPeriod(stamps, kFallbackS);
}

// Why the times of a scan's points cannot be those of a sweep, so that deskewing by them would
// distort it; empty if they can. Several sweeps in one scan are no sweep either, but two or three
// are deskewed well enough.
std::string TimesMisfit(const Scan& scan, const ScanPreparationOptions& preparation,
                        const std::vector<StampNs>& stamps) {
  // Longest span of the times in periods of a sweep; and in seconds for a first scan, whose stamp
  // tells no period.
  constexpr double kMostPeriods = 3.0, kMostS = 10.0;
  // Largest distance from the stamp. Readers of files put it near to the points
  // (io/points/point_times.h).
  constexpr double kMostOffS = 60.0;
  const bool used = preparation.deskew == ScanPreparationOptions::Deskew::kTime ||
                    preparation.deskew == ScanPreparationOptions::Deskew::kAuto;
  if (!used || scan.time_s.empty()) return "";
  // Stamps that are made up tell nothing of sweeps.
  const std::optional<double> apart_s = scan.stamp_made_up ? std::nullopt : TimeBetween(stamps);
  const double most_s = apart_s ? kMostPeriods * *apart_s : kMostS;
  const TimeSpan all = SpanOfTimes(scan.time_s);
  if (all.length_s() <= most_s && std::abs(all.low_s) <= kMostOffS) return "";
  const TimeSpan range = UsualSpanOfTimes(scan.time_s);
  const double span_s = range.length_s();
  char text[320] = "";
  if (span_s > most_s) {
    char but[64] = "no sweep lasts so long";
    if (apart_s) std::snprintf(but, sizeof(but), "scans are %.3g s apart", *apart_s);
    std::snprintf(text, sizeof(text),
                  "the times of its points span %.3g s, but %s: their unit is another "
                  "(scans.point_time_unit), or they are no times of a sweep "
                  "(preparation.deskew=off leaves them unused)",
                  span_s, but);
  } else if (std::max(-range.low_s, range.high_s) > kMostOffS) {
    std::snprintf(
        text, sizeof(text),
        "the times of its points are %.6g to %.6g s from its stamp, from which they count",
        range.low_s, range.high_s);
  }
  return text;
}

}  // namespace

void ClusterScan(const Scan& scan, const std::string& name,
                 const ScanPreparationOptions& preparation, int min_points, double leaf_size_m,
                 const std::vector<StampNs>& stamps, const SE3& T_vehicle_lidar,
                 DecodedScan* decoded) {
  MappedScan& report = decoded->report;
  const std::string misfit = TimesMisfit(scan, preparation, stamps);
  if (!misfit.empty()) return report.Skip(SkipReason::kUnreadable, name + ": " + misfit);
  Stopwatch watch;
  PreparedScan prepared = PrepareScan(scan, preparation, PeriodByStamps(stamps), T_vehicle_lidar);
  report.points = prepared.points.size();
  report.prepare_ms = watch.LapMilliseconds();
  if (report.points < static_cast<std::size_t>(min_points)) {
    report.Skip(SkipReason::kTooFewPoints,
                name + ": " + std::to_string(report.points) + " usable points, at least " +
                    std::to_string(min_points) + " wanted (" + std::to_string(prepared.non_finite) +
                    " not finite, " + std::to_string(prepared.out_of_range) + " out of range, " +
                    std::to_string(prepared.out_of_time) + " of no time of the scan)");
    return;
  }
  decoded->clusters = BuildScanClusters(prepared.points, leaf_size_m);
  report.clusters = decoded->clusters.size();
  report.cluster_ms = watch.LapMilliseconds();
  decoded->points = std::move(prepared.points);
}

DecodedScan DecodeScan(const ScanSource& source, const ScanPreparationOptions& preparation,
                       int min_points, double leaf_size_m, std::size_t begin, std::size_t i) {
  DecodedScan decoded;
  MappedScan& report = decoded.report;
  report.index = i;
  report.recording = source.Recording(i);
  report.sensor = source.Sensor(i);
  report.stamp_ns = source.Stamp(i);
  try {
    Stopwatch watch;
    const Scan scan = source.Read(i);
    report.stamp_ns = scan.stamp_ns;
    report.stamp_made_up = scan.stamp_made_up;
    report.read_ms = watch.LapMilliseconds();
    ClusterScan(scan, source.Name(i), preparation, min_points, leaf_size_m,
                StampsAt(source, begin, i), source.T_vehicle_lidar(i), &decoded);
  } catch (const InputError& error) {
    report.Skip(SkipReason::kUnreadable, error.what());
  }
  return decoded;
}

}  // namespace lamina
