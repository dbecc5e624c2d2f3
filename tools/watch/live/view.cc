#include "tools/watch/live/view.h"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>

#include "core/base/median.h"
#include "tools/http/token.h"
#include "tools/results/verdict/process_report.h"

namespace lamina {
namespace {

// Poses that one page of the trajectory holds at most: a copy of them takes well under 1 ms.
constexpr std::size_t kPagePoses = 8192;
constexpr std::chrono::seconds kInterest{5};
constexpr double kRateSpanS = 10.0;

// Whether a request came within the last seconds.
bool AskedLately(const std::atomic<std::chrono::steady_clock::rep>& asked) {
  using Clock = std::chrono::steady_clock;
  const Clock::rep at = asked.load(std::memory_order_relaxed);
  return at != 0 && Clock::now().time_since_epoch() - Clock::duration(at) < kInterest;
}

void NoteAsked(std::atomic<std::chrono::steady_clock::rep>* asked) {
  asked->store(std::chrono::steady_clock::now().time_since_epoch().count(),
               std::memory_order_relaxed);
}

bool SamePlace(const LivePose& a, const LivePose& b) {
  return a.T_world_lidar.t == b.T_world_lidar.t &&
         a.T_world_lidar.q.coeffs() == b.T_world_lidar.q.coeffs();
}

double Seconds(std::chrono::steady_clock::duration d) {
  return std::chrono::duration<double>(d).count();
}

}  // namespace

const char* ToString(LiveState state) {
  switch (state) {
    case LiveState::kStarting:
      return "starting";
    case LiveState::kMapping:
      return "mapping";
    case LiveState::kIdle:
      return "idle";
    case LiveState::kLocalising:
      return "localising";
    case LiveState::kStopping:
      break;
  }
  return "stopping";
}

LiveView::LiveView(std::size_t full_poses)
    : full_poses_(std::max<std::size_t>(full_poses, 2)), run_id_(RandomHex(8)) {}

void LiveView::SetStatus(LiveStatus status) {
  const std::lock_guard lock(mutex_);
  status_ = std::move(status);
  status_at_ = Clock::now();
}

void LiveView::AddFrame(const LiveFrame& frame) {
  const std::lock_guard lock(mutex_);
  Keep(frame.pose);
  timings_[timed_++ % kTimings] = {frame.times, Clock::now()};
}

void LiveView::AddPast(const LivePose& pose) {
  const std::lock_guard lock(mutex_);
  Keep(pose);
}

void LiveView::Keep(const LivePose& pose) {
  if (!recent_.empty() && pose.index <= recent_.back().pose.index) {
    throw std::logic_error(fmt::format("frame {} was published after frame {}", pose.index,
                                       recent_.back().pose.index));
  }
  recent_.push_back({pose, ++version_});
  while (!early_.empty() && early_.begin()->first <= pose.index) {
    if (early_.begin()->first == pose.index) recent_.back().pose = early_.begin()->second;
    early_.erase(early_.begin());
  }
  if (recent_.size() <= full_poses_) return;
  KeepThinned(recent_.front());
  recent_.pop_front();
}

void LiveView::KeepThinned(const Kept& kept) {
  if (old_seen_++ % old_stride_ != 0) return;
  old_.push_back(kept);
  if (old_.size() < full_poses_) return;
  for (std::size_t i = 0; 2 * i < old_.size(); ++i) old_[i] = old_[2 * i];
  old_.resize((old_.size() + 1) / 2);
  old_stride_ *= 2;
}

void LiveView::RevisePoses(const std::vector<LivePose>& poses) {
  const std::lock_guard lock(mutex_);
  ++version_;
  for (const LivePose& pose : poses) {
    const auto at = std::lower_bound(
        recent_.begin(), recent_.end(), pose.index,
        [](const Kept& kept, std::int64_t index) { return kept.pose.index < index; });
    if (at == recent_.end()) {
      early_[pose.index] = pose;
    } else if (at->pose.index == pose.index && !SamePlace(at->pose, pose)) {
      *at = {pose, version_};
    }
  }
}

void LiveView::SetScan(LiveScan scan) {
  auto shared = std::make_shared<const LiveScan>(std::move(scan));
  // Swapped, not assigned: an older scan that has no other owner is freed outside of the lock.
  const std::lock_guard lock(mutex_);
  scan_.swap(shared);
}

bool LiveView::ScanWanted() const { return AskedLately(scan_asked_); }

bool LiveView::PosesWanted() const { return AskedLately(poses_asked_); }

std::shared_ptr<const LiveScan> LiveView::Scan() const {
  NoteAsked(&scan_asked_);
  const std::lock_guard lock(mutex_);
  return scan_;
}

double LiveView::Rate(Clock::time_point now) const {
  const std::uint64_t kept = std::min<std::uint64_t>(timed_, kTimings);
  std::uint64_t frames = 0;
  while (frames < kept &&
         Seconds(now - timings_[(timed_ - 1 - frames) % kTimings].at) <= kRateSpanS) {
    ++frames;
  }
  if (frames < 2) return static_cast<double>(frames) / kRateSpanS;
  // A full ring, or a program that has just started, spans less time.
  const Clock::time_point oldest = timings_[(timed_ - frames) % kTimings].at;
  const double span = frames == kept ? Seconds(now - oldest) : kRateSpanS;
  return static_cast<double>(frames) / std::max(span, 1e-3);
}

LiveReport LiveView::Report() const {
  LiveReport report;
  std::vector<float> lags;
  lags.reserve(kTimings);
  const Clock::time_point now = Clock::now();
  {
    const std::lock_guard lock(mutex_);
    report.status = status_;
    report.rate_hz = Rate(now);
    if (!recent_.empty()) report.last = recent_.back().pose;
    const std::uint64_t kept = std::min<std::uint64_t>(timed_, kTimings);
    for (std::uint64_t i = timed_ - kept; i < timed_; ++i) {
      lags.push_back(timings_[i % kTimings].times.lag_ms);
    }
  }
  if (!lags.empty()) {
    report.lag_s = 1e-3 * static_cast<double>(lags.back());
    report.latency_median_ms = Quantile(&lags, 0.5);
    report.latency_p99_ms = Quantile(&lags, 0.99);
  }
  report.run_id = run_id_;
  report.uptime_s = Seconds(now - start_);
  if (report.status.checkpoint)
    report.checkpoint_age_s = Seconds(now - report.status.checkpoint->at);
  report.rss_bytes = ResidentBytes();
  return report;
}

std::string LiveView::Ailment(std::chrono::seconds stale_after) const {
  const std::lock_guard lock(mutex_);
  if (!status_.failure.empty()) return status_.failure;
  const double silent_s = Seconds(Clock::now() - status_at_);
  if (silent_s <= Seconds(stale_after)) return "";
  return fmt::format("no sign of life of the mapping thread for {:.0f} s", silent_s);
}

TrajectoryPage LiveView::Trajectory(std::int64_t since_version, std::int64_t from_index) const {
  NoteAsked(&poses_asked_);
  TrajectoryPage page;
  // Returns false when the page is full.
  const auto take = [&](const auto& list) {
    auto at = std::lower_bound(
        list.begin(), list.end(), from_index,
        [](const Kept& kept, std::int64_t index) { return kept.pose.index < index; });
    for (; at != list.end(); ++at) {
      if (at->version <= since_version) continue;
      if (page.poses.size() == kPagePoses) {
        page.next_index = at->pose.index;
        return false;
      }
      page.poses.push_back(at->pose);
    }
    return true;
  };
  page.poses.reserve(64);
  const std::lock_guard lock(mutex_);
  page.version = version_;
  if (take(old_)) take(recent_);
  return page;
}

TimingPage LiveView::Timings(std::uint64_t since) const {
  TimingPage page;
  const std::lock_guard lock(mutex_);
  const std::uint64_t kept = std::min<std::uint64_t>(timed_, kTimings);
  page.first = std::min(std::max(since, timed_ - kept), timed_);
  for (std::uint64_t i = page.first; i < timed_; ++i) {
    page.times.push_back(timings_[i % kTimings].times);
  }
  return page;
}

}  // namespace lamina
