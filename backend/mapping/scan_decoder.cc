#include "backend/mapping/scan_decoder.h"

#include <utility>

#include "core/base/error.h"
#include "core/base/printable_text.h"
#include "core/base/stopwatch.h"
#include "frontend/scan_clusters.h"

namespace lamina {
namespace {

double PeriodAt(const ScanSource& source, std::size_t begin, std::size_t i) {
  constexpr std::size_t kStamps = 10;
  constexpr double kFallbackS = 0.1;
  std::vector<StampNs> stamps = source.StampsUpTo(i, begin, kStamps + 1);
  // The first scan knows no period yet, but the next stamp is there to see.
  if (stamps.size() == 1) {
    if (const auto after = source.StampAfter(i)) stamps.push_back(*after);
  }
  return SweepPeriod(stamps, kFallbackS);
}

}  // namespace

void PipelineOptions::Visit(OptionVisitor& v) {
  v.Integer("lookahead_scans", &lookahead_scans, 1, 1000);
  v.Integer("min_points", &min_points, 1, 10000000);
  v.Integer("max_recordings", &max_recordings, 1, 1000);
}

const char* ToString(SkipReason reason) {
  switch (reason) {
    case SkipReason::kUnreadable:
      return "unreadable";
    case SkipReason::kTooFewPoints:
      return "too_few_points";
    case SkipReason::kStampNotAfterLast:
      return "stamp_not_after_last";
    case SkipReason::kNoRoomForPiece:
      return "no_room_for_piece";
    case SkipReason::kTooSoonAfterOtherSensor:
      return "too_soon_after_other_sensor";
  }
  return "unknown";
}

DecodedScan DecodeScan(const ScanSource& source, const ScanPreparationOptions& preparation,
                       int min_points, double leaf_size_m, std::size_t begin, std::size_t i) {
  DecodedScan decoded;
  ScanDecodeReport& report = decoded.report;
  report.index = i;
  report.recording = source.Recording(i);
  report.sensor = source.Sensor(i);
  report.stamp_ns = source.Stamp(i);
  Stopwatch watch;
  try {
    const Scan scan = source.Read(i);
    report.stamp_ns = scan.stamp_ns;
    report.stamp_made_up = scan.stamp_made_up;
    report.read_ms = watch.LapMilliseconds();
    PreparedScan prepared =
        PrepareScan(scan, preparation, PeriodAt(source, begin, i), source.T_vehicle_lidar(i));
    report.points = prepared.points.size();
    report.prepare_ms = watch.LapMilliseconds();
    if (report.points < static_cast<std::size_t>(min_points)) {
      report.skipped = true;
      report.reason = SkipReason::kTooFewPoints;
      report.detail = Printable(source.Name(i)) + ": " + std::to_string(report.points) +
                      " usable points, at least " + std::to_string(min_points) + " wanted (" +
                      std::to_string(prepared.non_finite) + " not finite, " +
                      std::to_string(prepared.out_of_range) + " out of range)";
      return decoded;
    }
    decoded.clusters = BuildScanClusters(prepared.points, leaf_size_m);
    report.clusters = decoded.clusters.size();
    report.cluster_ms = watch.LapMilliseconds();
    decoded.points = std::move(prepared.points);
  } catch (const InputError& error) {
    report.skipped = true;
    report.reason = SkipReason::kUnreadable;
    report.detail = Printable(error.what());
  }
  return decoded;
}

}  // namespace lamina
