#include "backend/mapping_pipeline.h"

#include <tbb/parallel_pipeline.h>
#include <tbb/task_group.h>

#include <memory>
#include <optional>
#include <utility>

#include "core/stopwatch.h"

namespace lamina {
namespace {

// What the first stage hands to the second.
struct PipelineScan {
  ScanReport report;
  std::vector<TimedCluster> clusters;
};

std::shared_ptr<PipelineScan> Decode(const ScanSource& source, const MappingOptions& options,
                                     std::size_t begin, std::size_t i) {
  auto scan = std::make_shared<PipelineScan>();
  DecodedScan decoded = DecodeScan(source, options.preparation, options.pipeline.min_points,
                                   options.mapper.map.LeafSize(), begin, i);
  static_cast<ScanDecodeReport&>(scan->report) = std::move(decoded.report);
  scan->clusters = std::move(decoded.clusters);
  return scan;
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
    group_.run([this] { result_ = AdjustBundle(problem_, options_.solver); });
  }

  double TakeIn() {
    group_.wait();
    pending_ = false;
    ++solves;
    if (!result_.usable()) ++failed;
    mapper_->ApplySolve(result_);
    return result_.solve_ms;
  }

  Mapper* mapper_;
  const BackendOptions& options_;
  tbb::task_group group_;
  bool pending_ = false;
  std::int64_t due_ = 0;
  BundleProblem problem_;
  BundleResult result_;
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

  void Process(PipelineScan* decoded) {
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
  void Map(PipelineScan* decoded) {
    ScanReport& report = decoded->report;
    last_stamp_ns_ = report.stamp_ns;
    report.solve_ms = solve_.TakeInIfDue(frames_);
    Stopwatch watch;
    const MappedFrame frame = mapper_->Process(report.stamp_ns, std::move(decoded->clusters));
    report.odometry_ms = watch.LapMilliseconds();
    solve_.StartIfDue(frames_);
    report.map_ms = watch.LapMilliseconds();
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
  const auto map = [&](const std::shared_ptr<PipelineScan>& decoded) {
    serial.Process(decoded.get());
  };
  using Decoded = std::shared_ptr<PipelineScan>;
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
