#include "backend/mapping_pipeline.h"

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

  // Whether a solve takes effect before frame number `frame`.
  bool Due(std::int64_t frame) const { return pending_ && frame >= due_; }
  // Whether it would have to be waited for.
  bool Solved() const { return solved_; }
  SolveReport TakeIn() {
    background_.Wait();
    pending_ = false;
    SolveReport report;
    report.discarded = !mapper_->ApplySolve(result_) && result_.usable();
    report.frames = problem_.poses.size();
    report.planes = problem_.planes.size();
    report.observations = problem_.observations.size();
    report.result = std::move(result_);
    return report;
  }

  // Call after frame number `frame`.
  void StartIfDue(std::int64_t frame) {
    if (pending_ || !mapper_->SolveDue()) return;
    problem_ = mapper_->PrepareSolve();
    Start();
    due_ = frame + 1 + options_.hand_over_lag_frames;
  }

  // What is still under way, then one last solve that includes the newest frames.
  std::vector<SolveReport> Finish() {
    std::vector<SolveReport> reports;
    if (pending_) reports.push_back(TakeIn());
    if (!mapper_->SolvePossible()) return reports;
    problem_ = mapper_->PrepareSolve();
    Start();
    reports.push_back(TakeIn());
    return reports;
  }

  void Archive(StateArchive& a) {
    a(&pending_, &due_);
    if (!pending_) return;
    a(&problem_);
    if (a.reading()) Start();
  }

 private:
  void Start() {
    pending_ = true;
    solved_ = false;
    background_.Start([this] {
      result_ = AdjustBundle(problem_, options_.solver);
      solved_ = true;
    });
  }

  Mapper* mapper_;
  const BackendOptions& options_;
  bool pending_ = false;
  std::int64_t due_ = 0;
  BundleProblem problem_;
  BundleResult result_;
  std::atomic<bool> solved_{false};
  Background background_;  // the last member: it waits before what it works on goes
};

}  // namespace

// The serial stage: everything that depends on the order of the scans.
class MappingPipeline::SerialStage {
 public:
  SerialStage(const MappingOptions& options, MappingCallbacks callbacks, VoxelStore* store)
      : options_(options),
        mapper_(options.mapper, store),
        solve_(&mapper_, options.mapper.backend),
        callbacks_(std::move(callbacks)) {}

  Mapper& mapper() { return mapper_; }
  const MappingCounts& counts() const { return counts_; }

  void Process(PipelineScan* decoded) {
    ScanReport& report = decoded->report;
    if (!report.skipped && any_ && report.stamp_ns <= last_stamp_ns_) {
      report.skipped = true;
      report.reason = SkipReason::kStampNotAfterLast;
      report.detail = "scan " + std::to_string(report.index) + ": its stamp " +
                      std::to_string(report.stamp_ns) + " ns is not after the last one, " +
                      std::to_string(last_stamp_ns_) + " ns";
    }
    ++counts_.scans;
    poses_.AddScan(report.index, report.stamp_ns, report.skipped);
    if (report.skipped) {
      ++counts_.skipped[report.reason];
    } else {
      Map(decoded);
    }
    if (callbacks_.on_scan) callbacks_.on_scan(report);
    HandOnFinalPoses(report.index);
    // Somebody may be waiting for the pose of this scan, and nobody yet for the next.
    if (!report.skipped) StartDueSolve();
    if (solve_.Solved()) TakeInDueSolve();
    if (callbacks_.on_settled) callbacks_.on_settled();
  }

  void TakeInDueSolve() {
    if (!solve_.Due(NextFrame())) return;
    const Stopwatch watch;
    taken_in_.push_back(solve_.TakeIn());
    hand_over_ms_ += watch.Milliseconds();
  }

  void Interrupt() {
    any_ = false;
    mapper_.Interrupt();
  }

  void Finish() {
    CountSolve(counts_.scans);
    for (const SolveReport& report : solve_.Finish()) Count(report, counts_.scans);
    poses_.ShowOpen(mapper_.OpenFrames(), Visitor());
  }

  void ShowOpenPoses(const FinalPoses::Visit& visit) const {
    poses_.ShowOpen(mapper_.OpenFrames(), visit);
  }

  void Archive(StateArchive& a) {
    a(&mapper_, &solve_, &counts_, &poses_, &any_, &last_stamp_ns_, &taken_in_);
  }

 private:
  std::int64_t NextFrame() const { return static_cast<std::int64_t>(counts_.frames); }

  void StartDueSolve() {
    const Stopwatch watch;
    solve_.StartIfDue(NextFrame() - 1);
    hand_over_ms_ += watch.Milliseconds();
  }

  // The solve that was taken in, early or not, counts from the scan on that sees its effect first.
  void CountSolve(std::size_t before_scan) {
    for (const SolveReport& report : taken_in_) Count(report, before_scan);
    taken_in_.clear();
  }

  void Map(PipelineScan* decoded) {
    ScanReport& report = decoded->report;
    last_stamp_ns_ = report.stamp_ns;
    any_ = true;
    TakeInDueSolve();
    for (const SolveReport& solve : taken_in_) report.solve_ms = solve.result.solve_ms;
    CountSolve(report.index);
    report.map_ms = std::exchange(hand_over_ms_, 0.0);
    const Stopwatch watch;
    const MappedFrame frame = mapper_.Process(static_cast<std::int64_t>(report.index),
                                              report.stamp_ns, std::move(decoded->clusters));
    report.odometry_ms = watch.Milliseconds();
    report.odometry = frame.odometry;
    report.keyframe = frame.keyframe;
    ++counts_.frames;
    counts_.keyframes += frame.keyframe ? 1 : 0;
    counts_.restarts += frame.restarted ? 1 : 0;
    counts_.lost += frame.odometry.status == OdometryFrame::Status::kLost ? 1 : 0;
    counts_.degenerate += frame.odometry.match.degenerate > 0 ? 1 : 0;
    counts_.searched += frame.odometry.searched ? 1 : 0;
  }

  void Count(SolveReport report, std::size_t before_scan) {
    report.before_scan = before_scan;
    ++counts_.solves;
    if (!report.result.usable()) ++counts_.failed_solves;
    if (report.discarded) ++counts_.discarded_solves;
    if (callbacks_.on_solve) callbacks_.on_solve(report);
  }

  FinalPoses::Visit Visitor() const {
    return [this](const FinalPose& pose) {
      if (callbacks_.on_final_pose) callbacks_.on_final_pose(pose);
    };
  }

  void HandOnFinalPoses(std::size_t scan) {
    const std::int64_t before =
        static_cast<std::int64_t>(scan) + 1 - options_.mapper.backend.final_after_frames;
    poses_.AddPoses(mapper_.TakeFinal(before), Visitor());
  }

  const MappingOptions& options_;
  Mapper mapper_;
  SolveInFlight solve_;
  MappingCallbacks callbacks_;
  MappingCounts counts_;
  FinalPoses poses_;
  bool any_ = false;
  StampNs last_stamp_ns_ = 0;
  std::vector<SolveReport> taken_in_;  // not counted yet; one at most
  double hand_over_ms_ = 0.0;          // since the last frame
};

// The way of a scan: read ahead, then mapped in order.
class MappingPipeline::ScanStages final : public PipelineStages {
 public:
  ScanStages(const ScanSource& source, const ScanRange& range, const std::atomic<bool>* stop,
             const MappingOptions& options, SerialStage* serial)
      : source_(source),
        range_(range),
        stop_(stop),
        options_(options),
        serial_(serial),
        under_way_(static_cast<std::size_t>(options.pipeline.lookahead_scans)) {}

  bool Begin(std::size_t i) override {
    return range_.next + i < range_.end && (stop_ == nullptr || !stop_->load());
  }
  void Work(std::size_t i) override {
    Slot(i) = Decode(source_, options_, range_.begin, range_.next + i);
  }
  void End(std::size_t i) override {
    serial_->Process(&Slot(i));
    Slot(i) = PipelineScan();
    ++processed_;
  }

  std::size_t processed() const { return processed_; }

 private:
  PipelineScan& Slot(std::size_t i) { return under_way_[i % under_way_.size()]; }

  const ScanSource& source_;
  const ScanRange range_;
  const std::atomic<bool>* stop_;
  const MappingOptions& options_;
  SerialStage* serial_;
  std::vector<PipelineScan> under_way_;
  std::size_t processed_ = 0;
};

void SolveReport::Archive(StateArchive& a) {
  a(&before_scan, &frames, &planes, &observations, &discarded, &result.status, &result.poses,
    &result.initial_cost, &result.final_cost, &result.iterations, &result.solve_ms);
}

void MappingCounts::Archive(StateArchive& a) {
  a(&scans, &frames, &keyframes, &lost, &restarts, &degenerate, &searched, &solves, &failed_solves,
    &discarded_solves);
  std::vector<SkipReason> reasons;
  std::vector<std::size_t> numbers;
  for (const auto& [reason, number] : skipped) {
    reasons.push_back(reason);
    numbers.push_back(number);
  }
  a(&reasons, &numbers);
  for (std::size_t i = 0; i < reasons.size(); ++i) skipped[reasons[i]] = numbers.at(i);
}

MappingPipeline::MappingPipeline(const MappingOptions& options, MappingCallbacks callbacks,
                                 VoxelStore* store)
    : options_(options),
      serial_(std::make_unique<SerialStage>(options_, std::move(callbacks), store)) {
  CheckOptions(options.preparation, "preparation");
  CheckOptions(options.pipeline, "pipeline");
}

MappingPipeline::~MappingPipeline() = default;

std::size_t MappingPipeline::Process(const ScanSource& source, const ScanRange& range,
                                     const std::atomic<bool>* stop) {
  ScanStages stages(source, range, stop, options_, serial_.get());
  RunPipeline(static_cast<std::size_t>(options_.pipeline.lookahead_scans), &stages);
  return stages.processed();
}

void MappingPipeline::Interrupt() { serial_->Interrupt(); }
void MappingPipeline::Settle() { serial_->TakeInDueSolve(); }
void MappingPipeline::Finish() { serial_->Finish(); }
void MappingPipeline::StartLocalising(const SE3& T) { serial_->mapper().StartLocalising(T); }
const MappingCounts& MappingPipeline::counts() const { return serial_->counts(); }
void MappingPipeline::ShowOpenPoses(const FinalPoses::Visit& visit) const {
  serial_->ShowOpenPoses(visit);
}
std::vector<Eigen::Vector3d> MappingPipeline::NewestKeyframe() const {
  return serial_->mapper().NewestKeyframe();
}
const VoxelMap& MappingPipeline::map() const { return serial_->mapper().map(); }
VoxelMap& MappingPipeline::map() { return serial_->mapper().map(); }
void MappingPipeline::Archive(StateArchive& a) { a(serial_.get()); }

}  // namespace lamina
