// What a mapping session remembers, in one SQLite file (write-ahead log, every commit on disk
// before it returns):
//
//     meta       key, value      version, the options that decide results; and the CRC-32 of each,
//                                under its key with .crc32 behind
//     scans      a row a scan    file, stamp, pose, covariance, figures (ScanRecord)
//     solves     a row a window that bundle adjustment solved
//     set_aside  files that never became a scan, and why
//
// Times are int64 ns. A pose is a blob of 7 f64, little-endian: qx qy qz qw tx ty tz; a covariance
// 36 f64. `crc` is the CRC-32 of all else in its row. A figure that is NaN is NULL.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "core/base/error.h"
#include "core/geometry/scan.h"
#include "io/store/scan_record.h"

namespace lamina {

struct SessionSolve {
  std::int64_t before_scan = 0;  // took effect before this scan
  std::int64_t frames = 0, planes = 0, observations = 0, iterations = 0;
  bool usable = false;
  double initial_cost = 0.0, final_cost = 0.0, solve_ms = 0.0;
};

// A change of a scan's pose.
struct SessionPose {
  std::int64_t scan = 0;
  SE3 T_world_lidar;
  bool skipped = false;   // not of its own points: a pose that is stays
  bool given_up = false;  // ScanRecord::GiveUp
};

// One connection; one thread at a time. Any number of connections may be open in one process. All
// members throw OutputError, naming the file, if it cannot be read or written.
class SessionDatabase {
 public:
  // Opens or makes it (an empty file is a new one). Throws OtherFormatError, naming the file, if it
  // is no such database or of another version; InputError, naming the file and a row if that is it,
  // if it is damaged: every page and every row is looked at if `check` is set.
  SessionDatabase(const std::string& path, bool check);
  ~SessionDatabase();

  // Throws InputError, naming file and key, if the value is not the one that was set.
  std::optional<std::string> Meta(const std::string& key) const;
  void SetMeta(const std::string& key, const std::string& value);

  // Between Begin and Commit all changes are one. What is not committed is undone.
  void Begin();
  void Commit();

  // Puts a scan in the place of what was known of it.
  void Put(const ScanRecord& scan);
  void Put(const SessionSolve& solve);
  // Makes a scan's pose final.
  void Finalise(const SessionPose& pose);
  void SetAside(const std::string& file, const std::string& reason);

  // Whether a file has become a scan or was set aside.
  bool Knows(const std::string& file) const;
  std::int64_t scans() const;  // number of the last one plus 1
  std::int64_t set_aside() const;
  // Scans [from, to) in order.
  void ForEach(std::int64_t from, std::int64_t to,
               const std::function<void(const ScanRecord&)>& visit) const;
  // The last scan of each sequence before `to`, and the number of its scans there.
  struct Sequence {
    ScanRecord last;
    std::int64_t scans = 0;
  };
  std::vector<Sequence> Sequences(std::int64_t to) const;
  // The last scans of a sequence before `to`, at most so many, in order.
  std::vector<ScanRecord> LastOf(const std::string& sequence, std::int64_t to, int most) const;
  // Forgets that solves before a scan or later happened: they are to be repeated.
  void DropSolvesFrom(std::int64_t scan);

  // For the writer, between Commit and Begin: keeps the log below some MB where Tidy() cannot, that
  // is while scans come without a pause.
  void LimitLog();
  // Brings the write-ahead log into the file, beside the writer.
  void Tidy();
  // A copy of the whole, as of one moment, on a temporary name and then renamed; on disk when this
  // returns. Throws OutputError; then nothing is left of it, and what was there before stays. Where
  // the copy would leave less than `room_left` bytes on the disk, that is a DiskFullError
  // (io/file/disk_room.h) before anything is written.
  void BackUpTo(const std::string& path, std::uint64_t room_left = 0) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

// Scans [0, to), in order, of a session that stays as it is, to the last byte of its folder. Throws
// InputError.
void ForEachScanOf(const std::string& path, std::int64_t to,
                   const std::function<void(const ScanRecord&)>& visit);

}  // namespace lamina
