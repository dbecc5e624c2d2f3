// What is remembered of a scan and of a solve.
#pragma once

#include "backend/mapping/final_poses.h"
#include "backend/mapping/mapped_scan.h"
#include "backend/mapping/report.h"
#include "io/store/session_database.h"

namespace lamina {

// Without the names of its file. The pose is the one that the scan has now.
ScanRecord RecordOf(const MappedScan& report);
SessionSolve RecordOf(const SolveReport& report);
FinalPose PoseOf(const ScanRecord& scan);
// A scan that was mapped once, and could not be read again, keeps the pose that it has in the
// database, whatever lies between those of its neighbours.
FinalPose AsRecorded(const SessionDatabase& database, const FinalPose& pose);

}  // namespace lamina
