// Sessions of made-up scans.
#pragma once

#include <SQLiteCpp/SQLiteCpp.h>
#include <gmock/gmock.h>

#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "core/geometry/state_archive.h"
#include "io/store/session_database.h"
#include "tests/support/files/io_test_files.h"
#include "tests/support/scenes/random_scenes.h"

namespace lamina {

// All fields as bytes, so that NaN equals NaN.
inline std::string BytesOf(ScanRecord s) {
  StateArchive a;
  bool has_next = s.next_stamp_ns.has_value();
  StampNs next = s.next_stamp_ns.value_or(0);
  a(&s.scan, &s.file, &s.sequence, &s.stamp_ns, &s.recorded_stamp, &has_next, &next, &s.skipped,
    &s.final, &s.T_world_lidar, &s.status, &s.detail, &s.keyframe, &s.searched, &s.points,
    &s.clusters, &s.matched, &s.iterations, &s.unobservable_directions, &s.inlier_share,
    &s.residual_m, &s.worst_sigma_m, &s.covariance, &s.read_ms, &s.prepare_ms, &s.cluster_ms,
    &s.odometry_ms, &s.map_ms, &s.solve_ms);
  return a.written();
}

inline ScanRecord ScanRow(std::int64_t number, const std::string& file,
                          const std::string& sequence = "") {
  Draws draws(static_cast<unsigned>(number));
  ScanRecord s;
  s.scan = number;
  s.file = file;
  s.sequence = sequence;
  s.stamp_ns = 1000 * number;
  s.T_world_lidar = draws.Pose(100.0);
  s.status = "tracked";
  return s;
}

// No field as it is by default.
inline ScanRecord FullRow(std::int64_t number, const std::string& file) {
  ScanRecord s = ScanRow(number, file, "drives/one");
  s.recorded_stamp = s.skipped = s.final = s.keyframe = s.searched = true;
  s.next_stamp_ns = -1;
  s.detail = "why: \"\xe2\x80\xa6\"\n\xff";
  s.points = 1;
  s.clusters = 2;
  s.matched = 3;
  s.iterations = 4;
  s.unobservable_directions = 5;
  s.inlier_share = 0.1;
  s.residual_m = 0.2;
  s.worst_sigma_m = 0.3;
  for (int i = 0; i < 36; ++i) s.covariance(i) = 0.1 * i;
  s.read_ms = 1.5;
  s.prepare_ms = 2.5;
  s.cluster_ms = 3.5;
  s.odometry_ms = 4.5;
  s.map_ms = 5.5;
  s.solve_ms = 6.5;
  return s;
}

class SessionDatabaseTest : public FilesTest {
 protected:
  std::string File() const { return Path("session.db"); }
  std::unique_ptr<SessionDatabase> Open() const {
    return std::make_unique<SessionDatabase>(File(), true);
  }
  static std::vector<ScanRecord> All(const SessionDatabase& database) {
    std::vector<ScanRecord> rows;
    database.ForEach(0, std::numeric_limits<std::int64_t>::max(),
                     [&](const ScanRecord& row) { rows.push_back(row); });
    return rows;
  }
  void Execute(const std::string& statement) const {
    SQLite::Database(File(), SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE).exec(statement);
  }
  std::string ErrorOnOpening() const {
    const std::string message = MessageOf<InputError>([this] { Open(); });
    EXPECT_THAT(message, testing::HasSubstr(File()));
    return message;
  }
  // A database of some pages, closed.
  void Fill(int rows) const {
    const auto database = Open();
    database->Begin();
    for (int i = 0; i < rows; ++i) database->Put(FullRow(i, std::to_string(i)));
    database->Commit();
  }
};

}  // namespace lamina
