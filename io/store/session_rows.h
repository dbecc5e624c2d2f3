// Rows of the session's database: the tables, and how their columns are written and read.
//
// Private to io/store.
#pragma once

#include <SQLiteCpp/SQLiteCpp.h>

#include <array>

#include "io/store/session_database.h"

namespace lamina {

// Makes the tables that are not there.
extern const char* const kSessionSchema;

// Bring a copy of the database up to date with the one that is attached to it as `session`; with a
// place for the number of the first scan that may have changed.
extern const std::array<const char*, 5> kAddToCopy;
// The number of scans in a database.
inline constexpr const char* kCountScans = "SELECT IFNULL(MAX(scan) + 1, 0) FROM scans";

// With a place for each column.
extern const char* const kPutScan;
extern const char* const kPutSolve;
void PutRow(const ScanRecord& scan, SQLite::Statement* statement);
void PutRow(const SessionSolve& solve, SQLite::Statement* statement);

// Sets pose and status of a scan that is as in `scan`.
extern const char* const kFinaliseScan;
void FinaliseRow(const ScanRecord& scan, SQLite::Statement* statement);

// Of all columns of scans. Throws InputError if the row does not fit its checksum.
ScanRecord ReadScanRow(SQLite::Statement* row);

// Sets a place (from 1) of a statement to bytes.
void BindBlob(int place, const std::string& bytes, SQLite::Statement* statement);

}  // namespace lamina
