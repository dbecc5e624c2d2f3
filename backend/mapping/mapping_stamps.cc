// Accepts or skips scans by their stamps.
#include <string>

#include "backend/mapping/mapping.h"
#include "backend/mapping/recording.h"

namespace lamina {

void Mapping::CheckStamp(Recording* recording, double sweep_s, MappedScan* report) {
  constexpr StampNs kLeastApartNs = 10'000'000;
  // The distance between scans that are closer than this part of their sweep is below the error of
  // their poses, which would be taken for a speed.
  constexpr double kLeastSweeps = 0.2;
  const std::string times = "scan " + std::to_string(report->index) + ": its stamp " +
                            std::to_string(report->stamp_ns) + " ns is not ";
  const std::string last = std::to_string(recording->last_stamp_ns) + " ns";
  const bool other = report->sensor != recording->last_sensor;
  // In this order: the difference of two stamps might not fit.
  if (report->stamp_ns < recording->last_stamp_ns ||
      (!other && report->stamp_ns == recording->last_stamp_ns)) {
    if (WasAhead(report->stamp_ns, *recording))
      return poses_.Disown(recording->stream, report->stamp_ns);
    if (!ClockWasSet(report->stamp_ns, recording))
      return report->Skip(SkipReason::kStampNotAfterLast, times + "after the last one, " + last);
    // A recording that is localised from a start goes on where it was.
    if (localise_from_) return;
    RegisteredScan before;
    before.ends = PieceEnd::kUnconnected;
    const Trajectory open = recording->OpenPoses();
    if (!open.empty()) before.odometry.T_world_predicted = open.back().T_world_lidar;
    BeginNextPiece(before, report->index, recording);
    report->began_piece = true;
  } else if (!other &&
             SecondsBetween(recording->last_stamp_ns, report->stamp_ns) < kLeastSweeps * sweep_s) {
    report->Skip(SkipReason::kStampNotAfterLast,
                 times + std::to_string(kLeastSweeps * sweep_s) +
                     " s, a fifth of its sweep, after the last one, " + last);
  } else if (other && SecondsBetween(recording->last_stamp_ns, report->stamp_ns) <
                          kSecondsPerNs * static_cast<double>(kLeastApartNs)) {
    report->Skip(SkipReason::kTooSoonAfterOtherSensor, times + "10 ms after that of sensor '" +
                                                           recording->last_sensor +
                                                           "' of its vehicle, " + last);
  }
}

// A single stamp far ahead of all others is wrong, and its scan is lost: the pose predicted for
// that time is far from where the sensor is.
bool Mapping::WasAhead(StampNs stamp_ns, const Recording& recording) {
  return recording.lost && stamp_ns > recording.matched_stamp_ns &&
         stamp_ns < recording.lost_stamp_ns;
}

// After a clock that was set back, or one stamp far ahead of a sensor that stands, every scan would
// be skipped. Scans in a row whose stamps follow one another, as those of late files among others
// do not, begin a piece of their own.
bool Mapping::ClockWasSet(StampNs stamp_ns, Recording* recording) const {
  constexpr std::int64_t kEnough = 10;
  const bool follows = recording->not_after == 0 || stamp_ns > recording->not_after_ns;
  recording->not_after = follows ? recording->not_after + 1 : 1;
  recording->not_after_ns = stamp_ns;
  return recording->not_after > kEnough && (localise_from_ || map_.RoomForPiece());
}

}  // namespace lamina
