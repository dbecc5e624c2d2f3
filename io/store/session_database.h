// What a mapping session remembers, in one SQLite file (write-ahead log, every commit on disk
// before it returns):
//
//     meta       key, value      version, the options that decide results; and the CRC-32 of each,
//                                under its key with .crc32 behind
//     scans      a row a scan    file, stamp, pose, covariance, figures (SessionScan)
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

namespace lamina {

// A scan as it is remembered. Figures as in frames.csv.
struct SessionScan {
  std::int64_t scan = 0;  // number in the session, from 0
  std::string file;       // its identity: the name in the inbox
  std::string sequence;
  StampNs stamp_ns = 0;
  bool recorded_stamp = false;
  std::optional<StampNs> next_stamp_ns;  // of the first scan of a sequence (InboxFile)
  std::int64_t piece = 0;                // of the map, in whose frame the pose is
  bool skipped = false;                  // the pose is not of its own points
  bool final = false;                    // nothing will change the pose any more
  SE3 T_world_lidar;

  std::string status;  // tracked, first, lost, degenerate, or why it was skipped
  std::string detail;  // of a skip
  bool keyframe = false, searched = false;
  std::int64_t points = 0, clusters = 0, matched = 0, iterations = 0, unobservable_directions = 0;
  double inlier_share = 0.0, residual_m = 0.0, worst_sigma_m = 0.0;
  Matrix6d covariance = Matrix6d::Zero();
  double read_ms = 0, prepare_ms = 0, cluster_ms = 0, odometry_ms = 0, map_ms = 0, solve_ms = 0;
};

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
  bool skipped = false;  // not of its own points: a pose that is stays
};

// Of a file that is whole, but another program's, or of another version: it must stay as it is.
struct OtherFormatError : InputError {
  using InputError::InputError;
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
  void Put(const SessionScan& scan);
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
               const std::function<void(const SessionScan&)>& visit) const;
  // The last scan of each sequence before `to`, and the number of its scans there.
  struct Sequence {
    SessionScan last;
    std::int64_t scans = 0;
  };
  std::vector<Sequence> Sequences(std::int64_t to) const;
  // The last scans of a sequence before `to`, at most so many, in order.
  std::vector<SessionScan> LastOf(const std::string& sequence, std::int64_t to, int most) const;
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
                   const std::function<void(const SessionScan&)>& visit);

}  // namespace lamina
