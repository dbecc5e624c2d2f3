// The state that the mapping thread shows to the threads of the page: what the daemon is doing now,
// in bounded memory however long it runs.
//
// The mapping thread writes (SetStatus, AddFrame, RevisePoses, SetScan), any number of threads
// read. All members are thread-safe; a lock is held for microseconds, so a slow reader costs the
// mapping thread nothing. In the daemon's loop:
//
//     LiveView view;
//     HttpServer server(*ParseHttpAddress("127.0.0.1:8090"), {&view, ...});  // server.h, here
//     for each scan {
//       ... map it, make it durable ...
//       view.AddFrame({index, stamp_ns, T_world_lidar, times});
//       view.RevisePoses(poses_that_are_final_now);
//       if (view.PosesWanted()) view.RevisePoses(poses_that_the_window_may_still_move);
//       if (view.ScanWanted()) view.SetScan({index, origin, points});
//       view.SetStatus(status);  // also every few seconds while idle: it is the sign of life
//     }
//
// What the board can tell by itself it does: uptime, rate, lag and its quantiles (over the newest
// 600 frames), resident memory, the last pose.
#pragma once

#include <Eigen/Core>
#include <array>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "core/geometry/scan.h"
#include "tools/results/verdict/verdict.h"

namespace lamina {

// Wall time of a frame by stage, and its lag: from the file being complete to its pose being
// durable.
struct StageTimes {
  float lag_ms = 0, read_ms = 0, prepare_ms = 0, cluster_ms = 0, odometry_ms = 0, map_ms = 0,
        solve_ms = 0, durable_ms = 0;
};

struct LivePose {
  std::int64_t index = 0;  // of the scan; grows from frame to frame, may skip numbers
  StampNs stamp_ns = 0;
  SE3 T_world_lidar;
  std::int64_t piece = 0;  // of the map, in whose frame it is
};

struct LiveFrame {
  LivePose pose;
  StageTimes times;
};

// Points of the newest scan, or the means of its clusters, relative to `origin`, frame of its
// piece.
struct LiveScan {
  std::int64_t index = 0;
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  std::vector<Eigen::Vector3f> points;  // 30000 are plenty for a picture
  std::int64_t piece = 0;
};

enum class LiveState { kStarting, kMapping, kIdle, kLocalising, kStopping };
const char* ToString(LiveState state);

// Counters count since the session began, not since the program started.
struct LiveStatus {
  struct Checkpoint {
    std::int64_t frame = 0;
    std::size_t bytes = 0;
    double write_ms = 0.0;
    std::chrono::steady_clock::time_point at = std::chrono::steady_clock::now();
  };

  LiveState state = LiveState::kStarting;
  std::uint64_t frames = 0, keyframes = 0, lost = 0, degenerate = 0, pieces = 0;
  std::uint64_t skipped = 0, rejected = 0, late = 0, solves = 0, failed_solves = 0;
  std::size_t queue = 0;  // complete files that wait in the inbox
  std::size_t map_bytes = 0, map_budget_bytes = 0, map_surfels = 0, tiles_on_disk = 0;
  int degenerate_directions = 0;  // of the newest frame; 0: every direction is held by the scene
  // Of the newest frame: from the frame of its pose to that of the map as loops have corrected it.
  SE3 T_map_world;
  RunVerdict verdict;  // on all scans so far
  std::optional<Checkpoint> checkpoint;
  std::string last_error;  // the newest that the stream survived; empty: none so far
  std::string failure;     // why the stream stands still; empty: it does not
};

// What the board adds to it.
struct LiveReport {
  LiveStatus status;
  std::string run_id;  // 16 hex digits, another one each time the program starts
  double uptime_s = 0.0, rate_hz = 0.0, lag_s = 0.0;
  double latency_median_ms = 0.0, latency_p99_ms = 0.0;
  double checkpoint_age_s = 0.0;
  std::size_t rss_bytes = 0;
  std::optional<LivePose> last;
};

// Poses in the order of their indices that changed after a version of the trajectory. Asked again
// from `next_index` until there is none, then with `version` of the FIRST page as `since`, a reader
// misses nothing.
struct TrajectoryPage {
  std::int64_t version = 0;
  std::optional<std::int64_t> next_index;
  std::vector<LivePose> poses;
};

// The newest stage times in the order of frames; `first` counts the frames since the program began.
struct TimingPage {
  std::uint64_t first = 0;
  std::vector<StageTimes> times;
};

class LiveView {
 public:
  // Of so many of the newest frames every pose is kept; of the older ones, every 2^k-th, at most as
  // many again.
  explicit LiveView(std::size_t full_poses = 20000);

  void SetStatus(LiveStatus status);
  // Indices must grow; throws std::logic_error otherwise.
  void AddFrame(const LiveFrame& frame);
  // A frame of an earlier run, which has no times. Before any AddFrame.
  void AddPast(const LivePose& pose);
  // New poses of frames, by index. Those that are no longer kept in full are passed over; those of
  // frames that are still to be added wait for them.
  void RevisePoses(const std::vector<LivePose>& poses);
  void SetScan(LiveScan scan);
  // Whether a scan was asked for within the last seconds: else there is no need for one.
  bool ScanWanted() const;
  // The same of the trajectory, for poses that are not final: there may be thousands of them.
  bool PosesWanted() const;

  LiveReport Report() const;
  // Why the daemon is not well; empty: it is. No SetStatus for `stale_after` counts as not well.
  std::string Ailment(std::chrono::seconds stale_after) const;
  TrajectoryPage Trajectory(std::int64_t since_version, std::int64_t from_index) const;
  // Those of frames `since` and newer, as far as they are kept.
  TimingPage Timings(std::uint64_t since) const;
  // Null before the first.
  std::shared_ptr<const LiveScan> Scan() const;
  const std::string& run_id() const { return run_id_; }

 private:
  using Clock = std::chrono::steady_clock;
  struct Kept {
    LivePose pose;
    std::int64_t version = 0;
  };
  struct Timed {
    StageTimes times;
    Clock::time_point at;
  };
  static constexpr std::size_t kTimings = 600;

  void Keep(const LivePose& pose);
  void KeepThinned(const Kept& kept);
  double Rate(Clock::time_point now) const;

  const std::size_t full_poses_;
  const std::string run_id_;
  const Clock::time_point start_ = Clock::now();
  mutable std::atomic<Clock::rep> scan_asked_{0}, poses_asked_{0};

  mutable std::mutex mutex_;  // guards all below
  LiveStatus status_;
  Clock::time_point status_at_ = start_;
  std::deque<Kept> recent_;
  std::vector<Kept> old_;
  std::uint64_t old_stride_ = 1, old_seen_ = 0;
  std::map<std::int64_t, LivePose> early_;  // revisions of frames that are still to be added
  std::int64_t version_ = 0;
  std::array<Timed, kTimings> timings_{};
  std::uint64_t timed_ = 0;
  std::shared_ptr<const LiveScan> scan_;
};

}  // namespace lamina
