#include "backend/mapping/mapped_scan.h"

#include "core/base/printable_text.h"

namespace lamina {

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

void MappedScan::Skip(SkipReason skip_reason, const std::string& why) {
  skipped = true;
  reason = skip_reason;
  detail = Printable(why);
}

const char* StatusName(const MappedScan& scan) {
  if (scan.skipped) return ToString(scan.reason);
  switch (scan.odometry.status) {
    case OdometryFrame::Status::kFirst:
      return "first";
    case OdometryFrame::Status::kLost:
      return "lost";
    case OdometryFrame::Status::kTracked:
      break;
  }
  return scan.odometry.match.degenerate > 0 ? "degenerate" : "tracked";
}

}  // namespace lamina
