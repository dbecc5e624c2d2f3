#include "backend/mapping/serial_mapping.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "core/base/stopwatch.h"

namespace lamina {
namespace {

constexpr std::int64_t kAllScans = std::numeric_limits<std::int64_t>::max();
// Of scans that no piece has room for.
constexpr FinalPoses::Stream kNoStream = -1;

void Skip(SkipReason reason, const std::string& why, ScanReport* report) {
  report->skipped = true;
  report->reason = reason;
  report->detail = "scan " + std::to_string(report->index) + ": " + why;
}

}  // namespace

SerialMapping::SerialMapping(const MappingOptions& options, MappingCallbacks callbacks,
                             VoxelStore* store)
    : options_(options), callbacks_(std::move(callbacks)), map_(options.mapper.map, store) {
  CheckOptions(options.mapper.odometry, "frontend");
  CheckOptions(options.mapper.backend, "backend");
  options.mapper.backend.CheckTogether();
}

void SerialMapping::Process(ScanReport* report, std::vector<TimedCluster>* clusters) {
  ++counts_.scans;
  Recording* const recording = FindOrBegin(*report);
  if (recording == nullptr) {
    Skip(SkipReason::kNoRoomForPiece,
         "the map holds " + std::to_string(kMostSlots) + " pieces and no more", report);
  } else {
    if (!report->skipped && recording->any) CheckStamp(*recording, report);
    if (!report->skipped) Map(recording, report, clusters);
    report->piece = recording->mapper->mapper().piece();
  }
  if (report->skipped) ++counts_.skipped[report->reason];
  poses_.AddScan(report->index, report->stamp_ns, report->skipped,
                 recording == nullptr ? kNoStream : recording->mapper->stream(), report->piece);
  if (recording == nullptr) poses_.Close(kNoStream);
  if (callbacks_.on_scan) callbacks_.on_scan(*report);
  HandOnFinalPoses(report->index);
  // Somebody may be waiting for the pose of this scan, and nobody yet for the next.
  if (!report->skipped) recording->mapper->StartDueSolve();
  SolveSilent(report->index);
  if (callbacks_.on_settled) callbacks_.on_settled();
}

void SerialMapping::CheckStamp(const Recording& recording, ScanReport* report) {
  constexpr StampNs kLeastApartNs = 10'000'000;
  const std::string times = "its stamp " + std::to_string(report->stamp_ns) + " ns is not ";
  const std::string last = std::to_string(recording.last_stamp_ns) + " ns";
  const bool other = report->sensor != recording.last_sensor;
  // In this order: the difference of two stamps might not fit.
  if (report->stamp_ns < recording.last_stamp_ns ||
      (!other && report->stamp_ns == recording.last_stamp_ns)) {
    Skip(SkipReason::kStampNotAfterLast, times + "after the last one, " + last, report);
  } else if (other && SecondsBetween(recording.last_stamp_ns, report->stamp_ns) <
                          kSecondsPerNs * static_cast<double>(kLeastApartNs)) {
    Skip(SkipReason::kTooSoonAfterOtherSensor,
         times + "10 ms after that of sensor '" + recording.last_sensor + "' of its vehicle, " +
             last,
         report);
  }
}

SerialMapping::Recording* SerialMapping::FindOrBegin(const ScanReport& report) {
  auto found = recordings_.find(report.recording);
  if (found == recordings_.end()) {
    if (recordings_.size() >= static_cast<std::size_t>(options_.pipeline.max_recordings)) {
      EndLongestSilent(report.index);
    }
    if (!localise_from_ && counts_.pieces > 0 && !map_.RoomForPiece()) return nullptr;
    found = recordings_.emplace(report.recording, Recording()).first;
    found->second.mapper = BeginPiece(SE3());
  }
  newest_ = report.recording;
  found->second.last_scan = static_cast<std::int64_t>(report.index);
  return &found->second;
}

std::unique_ptr<PieceMapper> SerialMapping::BeginPiece(const SE3& T_world_start) {
  std::int64_t piece = 0;
  if (localise_from_) {
    counts_.pieces = 1;
  } else {
    piece = static_cast<std::int64_t>(counts_.pieces++);
    // The first one is in the map from the beginning.
    if (piece > 0) map_.BeginPiece(piece);
  }
  auto mapper =
      std::make_unique<PieceMapper>(options_.mapper, &map_, piece, next_stream_++, T_world_start);
  if (localise_from_) mapper->mapper().StartLocalising(*localise_from_);
  return mapper;
}

void SerialMapping::EndLongestSilent(std::size_t scan) {
  const auto silent = std::min_element(
      recordings_.begin(), recordings_.end(),
      [](const auto& a, const auto& b) { return a.second.last_scan < b.second.last_scan; });
  End(silent->second.mapper.get(), scan);
  recordings_.erase(silent);
}

void SerialMapping::End(PieceMapper* mapper, std::size_t scan) {
  mapper->FinishSolves();
  CountSolves(mapper->TakeSolves(), scan);
  poses_.AddPoses(mapper->mapper().TakeFinal(kAllScans), mapper->stream());
  poses_.Close(mapper->stream());
  mapper->mapper().Close();
}

void SerialMapping::Map(Recording* recording, ScanReport* report,
                        std::vector<TimedCluster>* clusters) {
  recording->last_stamp_ns = report->stamp_ns;
  recording->last_sensor = report->sensor;
  recording->any = true;
  const MappedFrame frame = Register(recording, report, clusters);
  report->odometry = frame.odometry;
  report->keyframe = frame.keyframe;
  report->began_piece = frame.odometry.status == OdometryFrame::Status::kFirst;
  ++counts_.frames;
  counts_.keyframes += frame.keyframe ? 1 : 0;
  counts_.lost += frame.odometry.status == OdometryFrame::Status::kLost ? 1 : 0;
  counts_.degenerate += frame.odometry.match.degenerate > 0 ? 1 : 0;
  counts_.searched += frame.odometry.searched ? 1 : 0;
}

MappedFrame SerialMapping::Register(Recording* recording, ScanReport* report,
                                    std::vector<TimedCluster>* clusters) {
  const MapperScan scan{static_cast<std::int64_t>(report->index), report->stamp_ns,
                        report->stamp_made_up, clusters};
  PieceMapper* const mapper = recording->mapper.get();
  mapper->TakeInDueSolve();
  const std::vector<SolveReport> solves = mapper->TakeSolves();
  for (const SolveReport& solve : solves) report->solve_ms = solve.result.solve_ms;
  CountSolves(solves, report->index);
  report->map_ms = mapper->TakeHandOverMs();
  const Stopwatch watch;
  MappedFrame frame = mapper->Process(scan, map_.RoomForPiece());
  if (frame.to_restart) {
    // Where the sensor would be had it not been lost: what is drawn stays readable.
    const SE3 start = frame.odometry.T_world_predicted;
    End(mapper, report->index);
    ++counts_.restarts;
    recording->mapper = BeginPiece(map_.CanHold(start.t) ? start : SE3());
    frame = recording->mapper->Process(scan, false);
  }
  report->odometry_ms = watch.Milliseconds();
  return frame;
}

// A recording that has fallen silent gets the solve that ends it, before its poses are final by
// age. It may go on all the same.
void SerialMapping::SolveSilent(std::size_t scan) {
  const std::int64_t silent = std::max(1, options_.mapper.backend.final_after_frames / 2);
  for (auto& [name, recording] : recordings_) {
    if (static_cast<std::int64_t>(scan) - recording.last_scan == silent) {
      recording.mapper->FinishSolves();
    }
  }
}

// Solves count from the scan on that sees their effect first.
void SerialMapping::CountSolves(std::vector<SolveReport> solves, std::size_t before_scan) {
  for (SolveReport& report : solves) {
    report.before_scan = before_scan;
    ++counts_.solves;
    if (!report.result.usable()) ++counts_.failed_solves;
    if (report.discarded) ++counts_.discarded_solves;
    if (callbacks_.on_solve) callbacks_.on_solve(report);
  }
}

void SerialMapping::HandOnFinalPoses(std::size_t scan) {
  const std::int64_t before =
      static_cast<std::int64_t>(scan) + 1 - options_.mapper.backend.final_after_frames;
  for (auto& [name, recording] : recordings_) {
    PieceMapper& mapper = *recording.mapper;
    poses_.AddPoses(mapper.mapper().TakeFinal(before), mapper.stream());
  }
  poses_.HandOn(before, Visitor());
}

FinalPoses::Visit SerialMapping::Visitor() const {
  return [this](const FinalPose& pose) {
    if (callbacks_.on_final_pose) callbacks_.on_final_pose(pose);
  };
}

void SerialMapping::Finish() {
  for (auto& [name, recording] : recordings_) {
    recording.mapper->FinishSolves();
    CountSolves(recording.mapper->TakeSolves(), counts_.scans);
  }
  ShowOpenPoses(Visitor());
}

void SerialMapping::ShowOpenPoses(const FinalPoses::Visit& visit) const {
  std::map<FinalPoses::Stream, Trajectory> open;
  for (const auto& [name, recording] : recordings_) {
    open[recording.mapper->stream()] = recording.mapper->mapper().OpenFrames();
  }
  poses_.ShowOpen(open, visit);
}

std::vector<Eigen::Vector3d> SerialMapping::NewestKeyframe() const {
  const auto newest = recordings_.find(newest_);
  if (newest == recordings_.end()) return {};
  return newest->second.mapper->mapper().NewestKeyframe();
}

void SerialMapping::Settle() {
  for (auto& [name, recording] : recordings_) recording.mapper->TakeInDueSolve();
}

void SerialMapping::Archive(StateArchive& a) {
  bool localising = localise_from_.has_value();
  SE3 start = localise_from_.value_or(SE3());
  a(&counts_, &poses_, &localising, &start, &next_stream_, &newest_);
  if (a.reading()) localise_from_ = localising ? std::make_optional(start) : std::nullopt;
  std::vector<std::string> names;
  for (const auto& [name, recording] : recordings_) names.push_back(name);
  a(&names);
  if (a.reading()) recordings_.clear();
  for (const std::string& name : names) {
    Recording& recording = recordings_[name];
    std::int64_t piece = a.reading() ? 0 : recording.mapper->mapper().piece();
    FinalPoses::Stream stream = a.reading() ? 0 : recording.mapper->stream();
    a(&recording.any, &recording.last_stamp_ns, &recording.last_sensor, &recording.last_scan,
      &piece, &stream);
    if (a.reading()) {
      recording.mapper =
          std::make_unique<PieceMapper>(options_.mapper, &map_, piece, stream, SE3());
    }
    a(recording.mapper.get());
  }
}

void SolveReport::Archive(StateArchive& a) {
  a(&before_scan, &frames, &planes, &observations, &discarded, &result.status, &result.poses,
    &result.initial_cost, &result.final_cost, &result.iterations, &result.solve_ms);
}

void MappingCounts::Archive(StateArchive& a) {
  a(&scans, &frames, &keyframes, &lost, &restarts, &degenerate, &searched, &pieces, &solves,
    &failed_solves, &discarded_solves);
  std::vector<SkipReason> reasons;
  std::vector<std::size_t> numbers;
  for (const auto& [reason, number] : skipped) {
    reasons.push_back(reason);
    numbers.push_back(number);
  }
  a(&reasons, &numbers);
  for (std::size_t i = 0; i < reasons.size(); ++i) skipped[reasons[i]] = numbers.at(i);
}

}  // namespace lamina
