#include "backend/mapping/mapping.h"

#include <algorithm>
#include <limits>
#include <stdexcept>
#include <utility>

#include "backend/localisation/lost_searches.h"
#include "backend/localisation/piece_searches.h"
#include "backend/loops/piece_loops.h"
#include "backend/mapping/recording.h"
#include "core/base/stopwatch.h"

namespace lamina {
namespace {

constexpr std::int64_t kAllScans = std::numeric_limits<std::int64_t>::max();
// Stream of the scans that no piece has room for.
constexpr FinalPoses::Stream kNoStream = -1;

// Whether a recording that begins with this stamp comes after one that has got so far.
bool IsLater(StampNs stamp_ns, StampNs last_ns) {
  constexpr StampNs kApartNs = 15'000'000'000;
  return last_ns <= std::numeric_limits<StampNs>::max() - kApartNs &&
         stamp_ns >= last_ns + kApartNs;
}

MappingOptions Together(MappingOptions options) {
  options.mapper.pieces_are_found = options.loops.enabled;
  return options;
}

}  // namespace

void PipelineOptions::Visit(OptionVisitor& v) {
  v.Integer("lookahead_scans", &lookahead_scans, 1, 1000);
  v.Integer("min_points", &min_points, 1, 10000000);
  v.Integer("max_recordings", &max_recordings, 1, 1000);
}

Mapping::Mapping(const MappingOptions& options, MappingCallbacks callbacks, VoxelStore* store,
                 ByteStore* submaps)
    : options_(Together(options)),
      callbacks_(std::move(callbacks)),
      map_(options.mapper.map, store),
      recordings_(std::make_unique<std::map<std::string, Recording>>()) {
  CheckOptions(options.preparation, "preparation");
  CheckOptions(options.mapper.frontend, "frontend");
  CheckOptions(options.mapper.backend, "backend");
  CheckOptions(options.pipeline, "pipeline");
  options.preparation.CheckTogether();
  options.mapper.backend.CheckTogether();
  if (options_.loops.enabled) {
    loops_ = std::make_unique<PieceLoops>(options_.loops, options_.mapper.map,
                                          options_.mapper.frontend.matcher, submaps);
    lost_searches_ = std::make_unique<LostSearches>(
        options_.loops, options_.mapper.frontend.matcher, options_.mapper.map);
  }
}

Mapping::~Mapping() = default;

void Mapping::StartLocalising(const SE3& T_world_lidar) {
  localise_from_ = T_world_lidar;
  EndLoops();
}

void Mapping::StartLocalising(const std::vector<MapPlace>& places) {
  searches_ = std::make_unique<PieceSearches>(options_.loops, options_.mapper.frontend.matcher,
                                              places, map_);
  counts_.pieces = static_cast<std::size_t>(map_.LastPiece() + 1);
  EndLoops();
}

void Mapping::EndLoops() {
  loops_.reset();
  lost_searches_.reset();
}

DecodedScan Mapping::Decode(const ScanSource& source, std::size_t begin, std::size_t i) const {
  DecodedScan decoded = DecodeScan(source, options_.preparation, options_.pipeline.min_points,
                                   options_.mapper.map.LeafSize(), begin, i);
  decoded.points = {};  // clusters say all that mapping wants to know
  return decoded;
}

MappedScan Mapping::Add(const Scan& scan, const std::string& recording) {
  if (!scan.time_s.empty() && scan.time_s.size() != scan.points.size()) {
    throw std::logic_error("a scan has " + std::to_string(scan.points.size()) + " points and " +
                           std::to_string(scan.time_s.size()) + " times");
  }
  DecodedScan decoded;
  decoded.report.index = counts_.scans;
  decoded.report.recording = recording;
  decoded.report.sensor = recording;
  decoded.report.stamp_ns = scan.stamp_ns;
  decoded.report.stamp_made_up = scan.stamp_made_up;
  std::vector<StampNs>& stamps = stamps_[recording];
  if (stamps.size() == kPeriodStamps) stamps.erase(stamps.begin());
  stamps.push_back(scan.stamp_ns);
  ClusterScan(scan, "scan " + std::to_string(counts_.scans), options_.preparation,
              options_.pipeline.min_points, options_.mapper.map.LeafSize(), stamps, SE3(),
              &decoded);
  return Add(std::move(decoded));
}

MappedScan Mapping::Add(DecodedScan scan) {
  if (finished_) throw std::logic_error("no scan can be added to a mapping that is finished");
  TakeInDueSolves();
  MappedScan& report = scan.report;
  ++counts_.scans;
  Recording* const recording = FindOrBegin(report);
  if (recording == nullptr) {
    report.Skip(SkipReason::kNoRoomForPiece, "scan " + std::to_string(report.index) +
                                                 ": the map holds " + std::to_string(kMostSlots) +
                                                 " pieces and no more");
  } else {
    if (!report.skipped && recording->any)
      CheckStamp(recording, SweepLength(scan.clusters), &report);
    if (!report.skipped) Map(recording, &report, &scan.clusters);
    report.piece = recording->piece;
  }
  if (report.skipped) ++counts_.skipped[report.reason];
  poses_.AddScan(report.index, report.stamp_ns, report.skipped,
                 recording == nullptr ? kNoStream : recording->stream, report.piece);
  if (recording == nullptr) poses_.Close(kNoStream);
  if (callbacks_.on_scan) callbacks_.on_scan(report);
  HandOnFinalPoses(report.index);
  // After the callback: a caller may be waiting for the pose of this scan, none yet for the next.
  if (!report.skipped) {
    CorrectMap(report.piece);
    FindPlace(recording, report);
    if (recording->mapper != nullptr) recording->mapper->StartDueSolve();
  }
  SolveSilent(report.index);
  if (callbacks_.on_scan_done) callbacks_.on_scan_done();
  return std::move(report);
}

Mapping::Recording* Mapping::FindOrBegin(const MappedScan& report) {
  auto found = recordings_->find(report.recording);
  if (found == recordings_->end()) {
    if (recordings_->size() >= static_cast<std::size_t>(options_.pipeline.max_recordings)) {
      EndLongestSilent(report.index);
    }
    if (!localise_from_ && counts_.pieces > 0 && !map_.RoomForPiece()) return nullptr;
    for (auto& [name, recording] : *recordings_)
      recording.over |= recording.any && IsLater(report.stamp_ns, recording.last_stamp_ns);
    Recording begun;
    BeginPiece(SE3(), &begun);
    found = recordings_->emplace(report.recording, std::move(begun)).first;
  }
  if (found->second.rests() && !report.skipped && !Wake(&found->second)) return nullptr;
  newest_ = report.recording;
  found->second.over = false;
  found->second.last_scan = static_cast<std::int64_t>(report.index);
  return &found->second;
}

void Mapping::BeginPiece(const SE3& T_world_start, Recording* recording) {
  recording->stream = next_stream_++;
  recording->certain = 0;
  recording->mapper.reset();
  recording->localiser.reset();
  if (localise_from_) {
    counts_.pieces = 1;
    recording->piece = 0;
    recording->localiser = std::make_unique<Localiser>(options_.mapper, &map_, recording->piece);
    recording->localiser->Start(*localise_from_);
    return;
  }
  recording->piece = static_cast<std::int64_t>(counts_.pieces++);
  // The first one is in the map from the beginning.
  if (recording->piece > 0) map_.BeginPiece(recording->piece);
  if (searches_ != nullptr) searches_->Begin(recording->piece);
  MakeMapper(T_world_start, recording);
}

void Mapping::MakeMapper(const SE3& T_world_start, Recording* recording) {
  recording->mapper =
      std::make_unique<PieceMapper>(options_.mapper, &map_, recording->piece, T_world_start);
  ForwardFinalKeyframes(&recording->mapper->mapper());
}

void Mapping::ForwardFinalKeyframes(Mapper* mapper) {
  if (loops_ == nullptr && searches_ == nullptr && !callbacks_.on_final_keyframe) return;
  mapper->SetOnFinalKeyframe([this](std::int64_t piece, const FinalKeyframe& keyframe) {
    if (loops_ != nullptr) loops_->Track(piece)->Add(keyframe);
    if (searches_ != nullptr) searches_->Add(piece, keyframe);
    if (lost_searches_ != nullptr) lost_searches_->Add(piece, keyframe);
    if (callbacks_.on_final_keyframe) callbacks_.on_final_keyframe(piece, keyframe);
  });
}

void Mapping::CorrectMap(std::int64_t piece) {
  if (loops_ == nullptr || loops_->Find(piece) == nullptr) return;
  const auto parts = loops_->Track(piece)->Advance();
  if (!parts) return;
  map_.SelectPiece(piece);
  map_.ReplaceFixed(*parts);
}

void Mapping::EndLongestSilent(std::size_t scan) {
  const auto silent = std::min_element(
      recordings_->begin(), recordings_->end(),
      [](const auto& a, const auto& b) { return a.second.last_scan < b.second.last_scan; });
  End(&silent->second, scan);
  stamps_.erase(silent->first);
  recordings_->erase(silent);
}

void Mapping::End(Recording* recording, std::size_t scan) {
  if (recording->mapper != nullptr) {
    recording->mapper->FinishSolves();
    CountSolves(recording->mapper->TakeSolves(), scan);
  }
  poses_.AddPoses(recording->TakeFinal(kAllScans), recording->stream);
  poses_.Close(recording->stream);
  if (recording->mapper != nullptr) recording->mapper->mapper().Close();
  const std::int64_t piece = recording->piece;
  if (searches_ != nullptr) searches_->End(piece);
  if (lost_searches_ != nullptr) lost_searches_->End(piece);
  if (loops_ != nullptr && loops_->Find(piece) != nullptr) loops_->Track(piece)->Finish();
}

void Mapping::GiveUpStart(Recording* recording) {
  // After a long rest some poses are final already.
  const std::size_t open = poses_.GiveUp(recording->stream);
  counts_.degenerate += std::min(open, std::exchange(recording->certain, 0));
}

void Mapping::Map(Recording* recording, MappedScan* report, std::vector<TimedCluster>* clusters) {
  recording->last_stamp_ns = report->stamp_ns;
  recording->not_after = 0;
  recording->last_sensor = report->sensor;
  recording->any = true;
  const RegisteredScan frame = Register(recording, report, clusters);
  report->odometry = frame.odometry;
  MatchResult& match = report->odometry.match;
  // A match that only lacks certainty has no direction held: the mapper has taken it as it is.
  const bool tracked = frame.odometry.status == OdometryFrame::Status::kTracked;
  if (tracked && match.worst_sigma_m > options_.mapper.frontend.max_tracked_sigma_m)
    match.MakeDegenerate();
  const LoopTrack* const track = loops_ == nullptr ? nullptr : loops_->Find(recording->piece);
  if (track != nullptr) report->T_map_world = track->T_map_world();
  report->keyframe = frame.keyframe;
  report->began_piece =
      report->began_piece || frame.odometry.status == OdometryFrame::Status::kFirst;
  ++counts_.frames;
  counts_.keyframes += frame.keyframe ? 1 : 0;
  const bool lost = frame.odometry.status == OdometryFrame::Status::kLost;
  counts_.lost += lost ? 1 : 0;
  if (!lost) recording->matched_stamp_ns = report->stamp_ns;
  if (lost && !recording->lost) recording->lost_stamp_ns = report->stamp_ns;
  recording->lost = lost;
  const bool degenerate = tracked && match.degenerate > 0;
  counts_.degenerate += degenerate ? 1 : 0;
  recording->certain += tracked && !degenerate ? 1 : 0;
  counts_.searched += frame.odometry.searched ? 1 : 0;
}

RegisteredScan Mapping::Register(Recording* recording, MappedScan* report,
                                 std::vector<TimedCluster>* clusters) {
  const MapperScan scan{static_cast<std::int64_t>(report->index), report->stamp_ns,
                        report->stamp_made_up, clusters, CentreTimes(clusters)};
  if (recording->mapper != nullptr) {
    const std::vector<SolveReport> solves = recording->mapper->TakeSolves();
    for (const SolveReport& solve : solves) report->solve_ms = solve.result.solve_ms;
    CountSolves(solves, report->index);
    report->map_ms = recording->mapper->TakeHandOverMs();
  }
  const Stopwatch watch;
  RegisteredScan frame = recording->Process(scan, map_.RoomForPiece());
  if (frame.ends != PieceEnd::kNone) {
    BeginNextPiece(frame, report->index, recording);
    report->began_piece = true;
    frame = recording->Process(scan, false);
  }
  if (frame.start_uncertain) GiveUpStart(recording);
  report->odometry_ms = watch.Milliseconds();
  return frame;
}

void Mapping::BeginNextPiece(const RegisteredScan& last, std::size_t scan, Recording* recording) {
  // The next piece begins at the estimated pose, or at the predicted one if the sensor is lost, so
  // that plots stay readable.
  const bool continued = last.ends == PieceEnd::kContinued;
  const SE3 start = continued ? last.odometry.T_world_lidar : last.odometry.T_world_predicted;
  const bool holds = map_.CanHold(start.t);
  std::vector<WindowFrame> settled;
  if (continued && holds) settled = recording->mapper->mapper().SettledFrames();
  if (recording->mapper != nullptr && recording->mapper->mapper().start_given_up())
    GiveUpStart(recording);
  End(recording, scan);
  // Null where the piece that ends is one of the map that the sensor was localised in.
  const std::unique_ptr<PieceMapper> before = std::move(recording->mapper);
  ++counts_.restarts;
  BeginPiece(holds ? start : SE3(), recording);
  if (before != nullptr) recording->mapper->mapper().StartAfter(before->mapper());
  if (continued && holds)
    recording->mapper->mapper().GoOnFrom(before->mapper(), std::move(settled));
}

// A recording that has fallen silent gets the solve that ends it, before its poses are final by
// age. It may go on all the same.
void Mapping::SolveSilent(std::size_t scan) {
  for (auto& [name, recording] : *recordings_) {
    if (static_cast<std::int64_t>(scan) - recording.last_scan != SilentScans()) continue;
    TakeInDueSolves();
    if (recording.mapper == nullptr) continue;
    recording.mapper->FinishSolves();
    recording.last = recording.LastPoses();
  }
}

std::int64_t Mapping::SilentScans() const {
  return std::max(1, options_.mapper.backend.final_after_frames / 2);
}

// Solves count from the scan on that sees their effect first.
void Mapping::CountSolves(std::vector<SolveReport> solves, std::size_t before_scan) {
  for (SolveReport& report : solves) {
    report.before_scan = before_scan;
    ++counts_.solves;
    if (!report.result.usable()) ++counts_.failed_solves;
    if (report.discarded) ++counts_.discarded_solves;
    if (callbacks_.on_solve) callbacks_.on_solve(report);
  }
}

void Mapping::HandOnFinalPoses(std::size_t scan) {
  const std::int64_t before =
      static_cast<std::int64_t>(scan) + 1 - options_.mapper.backend.final_after_frames;
  for (auto& [name, recording] : *recordings_) {
    poses_.AddPoses(recording.TakeFinal(before), recording.stream);
  }
  poses_.HandOn(before, Visitor());
}

FinalPoses::Visit Mapping::Visitor() const {
  return [this](const FinalPose& pose) {
    if (callbacks_.on_final_pose) callbacks_.on_final_pose(pose);
  };
}

void Mapping::Finish() {
  if (std::exchange(finished_, true)) return;
  for (auto& [name, recording] : *recordings_) {
    if (recording.mapper == nullptr) continue;
    recording.mapper->FinishSolves();
    CountSolves(recording.mapper->TakeSolves(), counts_.scans);
    recording.mapper->mapper().EmitWindowKeyframes();
  }
  if (loops_ != nullptr) loops_->Finish();
  ShowOpenPoses(Visitor());
}

void Mapping::ShowOpenPoses(const FinalPoses::Visit& visit) const {
  std::map<FinalPoses::Stream, Trajectory> open;
  for (const auto& [name, recording] : *recordings_) open[recording.stream] = recording.OpenPoses();
  poses_.ShowOpen(open, visit);
}

std::vector<Eigen::Vector3d> Mapping::NewestKeyframe() const {
  const auto newest = recordings_->find(newest_);
  if (newest == recordings_->end() || newest->second.mapper == nullptr) return {};
  return newest->second.mapper->mapper().NewestKeyframe();
}

void Mapping::TakeInDueSolves() {
  for (auto& [name, recording] : *recordings_) {
    if (recording.mapper != nullptr) recording.mapper->TakeInDueSolve();
  }
}

}  // namespace lamina
