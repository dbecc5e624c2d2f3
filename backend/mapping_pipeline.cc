#include "backend/mapping_pipeline.h"

#include <tbb/parallel_pipeline.h>
#include <tbb/task_group.h>

#include <chrono>
#include <memory>
#include <optional>
#include <utility>

#include "core/error.h"
#include "frontend/scan_clusters.h"

namespace lamina {
namespace {

using Clock = std::chrono::steady_clock;

double MillisecondsSince(Clock::time_point* last) {
  const Clock::time_point now = Clock::now();
  const double ms = std::chrono::duration<double, std::milli>(now - *last).count();
  *last = now;
  return ms;
}

// What the first stage hands to the second.
struct DecodedScan {
  ScanReport report;
  std::vector<TimedCluster> clusters;
};

double PeriodAt(const ScanSource& source, std::size_t begin, std::size_t i) {
  constexpr std::size_t kStamps = 10;
  constexpr double kFallbackS = 0.1;
  std::vector<StampNs> stamps;
  for (std::size_t k = std::max(begin, i >= kStamps ? i - kStamps : 0); k <= i; ++k) {
    stamps.push_back(source.Stamp(k));
  }
  // The first scan knows no period yet, but the next stamp is there to see.
  if (stamps.size() == 1 && i + 1 < source.size()) stamps.push_back(source.Stamp(i + 1));
  return SweepPeriod(stamps, kFallbackS);
}

std::shared_ptr<DecodedScan> Decode(const ScanSource& source, const MappingOptions& options,
                                    std::size_t begin, std::size_t i) {
  auto decoded = std::make_shared<DecodedScan>();
  ScanReport& report = decoded->report;
  report.index = i;
  report.stamp_ns = source.Stamp(i);
  Clock::time_point clock = Clock::now();
  try {
    const Scan scan = source.Read(i);
    report.stamp_ns = scan.stamp_ns;
    report.read_ms = MillisecondsSince(&clock);
    const PreparedScan prepared =
        PrepareScan(scan, options.preparation, PeriodAt(source, begin, i));
    report.points = prepared.points.size();
    report.prepare_ms = MillisecondsSince(&clock);
    if (report.points < static_cast<std::size_t>(options.pipeline.min_points)) {
      report.skipped = true;
      report.reason = SkipReason::kTooFewPoints;
      report.detail = source.Name(i) + ": " + std::to_string(report.points) +
                      " usable points, at least " + std::to_string(options.pipeline.min_points) +
                      " wanted (" + std::to_string(prepared.non_finite) + " not finite, " +
                      std::to_string(prepared.out_of_range) + " out of range)";
      return decoded;
    }
    decoded->clusters = BuildScanClusters(prepared.points, options.mapper.map.LeafSize());
    report.clusters = decoded->clusters.size();
    report.cluster_ms = MillisecondsSince(&clock);
  } catch (const InputError& error) {
    report.skipped = true;
    report.reason = SkipReason::kUnreadable;
    report.detail = error.what();
  }
  return decoded;
}

// The solve that is under way: started after a frame, taken in a fixed number of frames later.
class SolveInFlight {
 public:
  SolveInFlight(Mapper* mapper, const BackendOptions& options)
      : mapper_(mapper), options_(options) {}
  ~SolveInFlight() { group_.wait(); }

  // Call before frame number `frame`. Returns the time that the solve took, 0 if none was due.
  double TakeInIfDue(std::int64_t frame) { return pending_ && frame >= due_ ? TakeIn() : 0.0; }

  // Call after frame number `frame`.
  void StartIfDue(std::int64_t frame) {
    if (pending_ || !mapper_->SolveDue()) return;
    Start();
    due_ = frame + 1 + options_.hand_over_lag_frames;
  }

  // What is still under way, then one last solve that includes the newest frames.
  void Finish() {
    if (pending_) TakeIn();
    if (!mapper_->SolvePossible()) return;
    Start();
    TakeIn();
  }

  std::size_t solves = 0, failed = 0;

 private:
  void Start() {
    pending_ = true;
    problem_ = mapper_->PrepareSolve();
    group_.run([this] {
      Clock::time_point clock = Clock::now();
      result_ = AdjustBundle(problem_, options_.solver);
      solve_ms_ = MillisecondsSince(&clock);
    });
  }

  double TakeIn() {
    group_.wait();
    pending_ = false;
    ++solves;
    if (!result_.usable()) ++failed;
    mapper_->ApplySolve(result_);
    return solve_ms_;
  }

  Mapper* mapper_;
  const BackendOptions& options_;
  tbb::task_group group_;
  bool pending_ = false;
  std::int64_t due_ = 0;
  BundleProblem problem_;
  BundleResult result_;
  double solve_ms_ = 0.0;
};

// Poses for all scans: those that were skipped lie between their neighbours, by stamp where that is
// possible.
Trajectory FillSkipped(const std::vector<std::pair<StampNs, bool>>& scans,
                       const Trajectory& frames) {
  Trajectory all;
  std::size_t next = 0;
  for (const auto& [stamp_ns, has_pose] : scans) {
    if (has_pose) {
      all.push_back(frames[next++]);
      continue;
    }
    StampedPose pose;
    pose.stamp_ns = stamp_ns;
    if (next > 0) pose.T_world_lidar = frames[next - 1].T_world_lidar;
    if (next == 0 && !frames.empty()) pose.T_world_lidar = frames[0].T_world_lidar;
    if (next > 0 && next < frames.size() && stamp_ns > frames[next - 1].stamp_ns &&
        stamp_ns < frames[next].stamp_ns) {
      const double s = SecondsBetween(frames[next - 1].stamp_ns, stamp_ns) /
                       SecondsBetween(frames[next - 1].stamp_ns, frames[next].stamp_ns);
      pose.T_world_lidar =
          Interpolate(frames[next - 1].T_world_lidar, frames[next].T_world_lidar, s);
    }
    all.push_back(pose);
  }
  return all;
}

// The serial stage: everything that depends on the order of the scans.
class SerialStage {
 public:
  SerialStage(Mapper* mapper, const MappingOptions& options, const MappingCallbacks& callbacks)
      : mapper_(mapper), solve_(mapper, options.mapper.backend), callbacks_(callbacks) {}

  void Process(DecodedScan* decoded) {
    ScanReport& report = decoded->report;
    if (!report.skipped && frames_ > 0 && report.stamp_ns <= last_stamp_ns_) {
      report.skipped = true;
      report.reason = SkipReason::kStampNotAfterLast;
      report.detail = "scan " + std::to_string(report.index) + ": its stamp " +
                      std::to_string(report.stamp_ns) + " ns is not after the last one, " +
                      std::to_string(last_stamp_ns_) + " ns";
    }
    scans_.emplace_back(report.stamp_ns, !report.skipped);
    if (report.skipped) {
      ++result_.skipped[report.reason];
    } else {
      Map(decoded);
    }
    if (callbacks_.on_scan) callbacks_.on_scan(report);
  }

  MappingResult Finish() {
    solve_.Finish();
    result_.frames = mapper_->CurrentTrajectory();
    result_.all_scans = FillSkipped(scans_, result_.frames);
    result_.solves = solve_.solves;
    result_.failed_solves = solve_.failed;
    return std::move(result_);
  }

 private:
  void Map(DecodedScan* decoded) {
    ScanReport& report = decoded->report;
    last_stamp_ns_ = report.stamp_ns;
    report.solve_ms = solve_.TakeInIfDue(frames_);
    Clock::time_point clock = Clock::now();
    const MappedFrame frame = mapper_->Process(report.stamp_ns, std::move(decoded->clusters));
    report.odometry_ms = MillisecondsSince(&clock);
    solve_.StartIfDue(frames_);
    report.map_ms = MillisecondsSince(&clock);
    ++frames_;
    report.odometry = frame.odometry;
    report.keyframe = frame.keyframe;
    result_.keyframes += frame.keyframe ? 1 : 0;
    result_.restarts += frame.restarted ? 1 : 0;
    result_.lost += frame.odometry.status == OdometryFrame::Status::kLost ? 1 : 0;
    result_.degenerate += frame.odometry.match.degenerate > 0 ? 1 : 0;
    result_.searched += frame.odometry.searched ? 1 : 0;
  }

  Mapper* mapper_;
  SolveInFlight solve_;
  const MappingCallbacks& callbacks_;
  MappingResult result_;
  std::vector<std::pair<StampNs, bool>> scans_;
  std::int64_t frames_ = 0;
  StampNs last_stamp_ns_ = 0;
};

}  // namespace

void PipelineOptions::Visit(OptionVisitor& v) {
  v.Integer("lookahead_scans", &lookahead_scans, 1, 1000);
  v.Integer("min_points", &min_points, 1, 10000000);
}

const char* ToString(SkipReason reason) {
  switch (reason) {
    case SkipReason::kUnreadable:
      return "unreadable";
    case SkipReason::kTooFewPoints:
      return "too_few_points";
    case SkipReason::kStampNotAfterLast:
      return "stamp_not_after_last";
  }
  return "unknown";
}

MappingPipeline::MappingPipeline(const MappingOptions& options,
                                 std::function<void(const Surfel&)> on_evicted)
    : options_(options), mapper_(options.mapper, std::move(on_evicted)) {
  CheckOptions(options.preparation, "preparation");
  CheckOptions(options.pipeline, "pipeline");
}

MappingResult MappingPipeline::Run(const ScanSource& source, std::size_t begin, std::size_t end,
                                   const MappingCallbacks& callbacks,
                                   const std::atomic<bool>* stop) {
  SerialStage serial(&mapper_, options_, callbacks);
  std::size_t next = begin;
  bool interrupted = false;
  const auto feed = [&](tbb::flow_control& control) -> std::size_t {
    interrupted = stop != nullptr && stop->load();
    if (next >= end || interrupted) control.stop();
    return next++;
  };
  const auto decode = [&](std::size_t i) { return Decode(source, options_, begin, i); };
  const auto map = [&](const std::shared_ptr<DecodedScan>& decoded) {
    serial.Process(decoded.get());
  };
  using Decoded = std::shared_ptr<DecodedScan>;
  tbb::parallel_pipeline(
      static_cast<std::size_t>(options_.pipeline.lookahead_scans),
      tbb::make_filter<void, std::size_t>(tbb::filter_mode::serial_in_order, feed) &
          tbb::make_filter<std::size_t, Decoded>(tbb::filter_mode::parallel, decode) &
          tbb::make_filter<Decoded, void>(tbb::filter_mode::serial_in_order, map));
  MappingResult result = serial.Finish();
  result.interrupted = interrupted;
  return result;
}

}  // namespace lamina
