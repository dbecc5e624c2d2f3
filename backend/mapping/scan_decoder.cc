#include "backend/mapping/scan_decoder.h"

#include <utility>

#include "core/base/error.h"
#include "core/base/printable_text.h"
#include "core/base/stopwatch.h"
#include "frontend/scan_clusters.h"

namespace lamina {
namespace {

double PeriodAt(const ScanSource& source, std::size_t begin, std::size_t i) {
  std::vector<StampNs> stamps = source.StampsUpTo(i, begin, kPeriodStamps);
  // The first scan knows no period yet, but the next stamp is there to see.
  if (stamps.size() == 1) {
    if (const auto after = source.StampAfter(i)) stamps.push_back(*after);
  }
  return PeriodByStamps(stamps);
}

void Skip(SkipReason reason, const std::string& why, MappedScan* report) {
  report->skipped = true;
  report->reason = reason;
  report->detail = Printable(why);
}

}  // namespace

double PeriodByStamps(const std::vector<StampNs>& stamps) {
  constexpr double kFallbackS = 0.1;
  return SweepPeriod(stamps, kFallbackS);
}

void ClusterScan(const Scan& scan, const std::string& name,
                 const ScanPreparationOptions& preparation, int min_points, double leaf_size_m,
                 double sweep_period_s, const SE3& T_vehicle_lidar, DecodedScan* decoded) {
  MappedScan& report = decoded->report;
  Stopwatch watch;
  PreparedScan prepared = PrepareScan(scan, preparation, sweep_period_s, T_vehicle_lidar);
  report.points = prepared.points.size();
  report.prepare_ms = watch.LapMilliseconds();
  if (report.points < static_cast<std::size_t>(min_points)) {
    Skip(SkipReason::kTooFewPoints,
         name + ": " + std::to_string(report.points) + " usable points, at least " +
             std::to_string(min_points) + " wanted (" + std::to_string(prepared.non_finite) +
             " not finite, " + std::to_string(prepared.out_of_range) + " out of range)",
         &report);
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
                PeriodAt(source, begin, i), source.T_vehicle_lidar(i), &decoded);
  } catch (const InputError& error) {
    Skip(SkipReason::kUnreadable, error.what(), &report);
  }
  return decoded;
}

}  // namespace lamina
