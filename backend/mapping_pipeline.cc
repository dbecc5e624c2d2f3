#include "backend/mapping_pipeline.h"

#include <optional>
#include <utility>

#include "core/parallel.h"
#include "core/stopwatch.h"

namespace lamina {
namespace {

// What the first stage hands to the second.
struct PipelineScan {
  ScanReport report;
  std::vector<TimedCluster> clusters;
};

PipelineScan Decode(const ScanSource& source, const MappingOptions& options, std::size_t begin,
                    std::size_t i) {
  DecodedScan decoded = DecodeScan(source, options.preparation, options.pipeline.min_points,
                                   options.mapper.map.LeafSize(), begin, i);
  PipelineScan scan;
  static_cast<ScanDecodeReport&>(scan.report) = std::move(decoded.report);
  scan.clusters = std::move(decoded.clusters);
  return scan;
}

// The solve that is under way: started after a frame, taken in a fixed number of frames later.
class SolveInFlight {
 public:
  SolveInFlight(Mapper* mapper, const BackendOptions& options)
      : mapper_(mapper), options_(options) {}

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
    background_.Start([this] { result_ = AdjustBundle(problem_, options_.solver); });
  }

  double TakeIn() {
    background_.Wait();
    pending_ = false;
    ++solves;
    if (!result_.usable()) ++failed;
    mapper_->ApplySolve(result_);
    return result_.solve_ms;
  }

  Mapper* mapper_;
  const BackendOptions& options_;
  bool pending_ = false;
  std::int64_t due_ = 0;
  BundleProblem problem_;
  BundleResult result_;
  Background background_;  // the last member: it waits before what it works on goes
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

// The way of a scan: read ahead, then mapped in order.
class ScanStages final : public PipelineStages {
 public:
  ScanStages(const ScanSource& source, std::size_t begin, std::size_t end,
             const std::atomic<bool>* stop, const MappingOptions& options, Mapper* mapper,
             const MappingCallbacks& callbacks)
      : source_(source),
        begin_(begin),
        end_(end),
        stop_(stop),
        options_(options),
        serial_(mapper, options, callbacks),
        under_way_(static_cast<std::size_t>(options.pipeline.lookahead_scans)) {}

  bool Begin(std::size_t i) override {
    interrupted_ = stop_ != nullptr && stop_->load();
    return begin_ + i < end_ && !interrupted_;
  }
  void Work(std::size_t i) override { Slot(i) = Decode(source_, options_, begin_, begin_ + i); }
  void End(std::size_t i) override { serial_.Process(&Slot(i)); }

  MappingResult Finish() {
    MappingResult result = serial_.Finish();
    result.interrupted = interrupted_;
    return result;
  }

 private:
  PipelineScan& Slot(std::size_t i) { return under_way_[i % under_way_.size()]; }

  const ScanSource& source_;
  const std::size_t begin_, end_;
  const std::atomic<bool>* stop_;
  const MappingOptions& options_;
  SerialStage serial_;
  std::vector<PipelineScan> under_way_;
  bool interrupted_ = false;
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
  ScanStages stages(source, begin, end, stop, options_, &mapper_, callbacks);
  RunPipeline(static_cast<std::size_t>(options_.pipeline.lookahead_scans), &stages);
  return stages.Finish();
}

}  // namespace lamina
