#include "backend/mapping/piece_mapper.h"

#include <utility>

#include "core/base/stopwatch.h"

namespace lamina {

PieceMapper::PieceMapper(const MapperOptions& options, VoxelMap* map, std::int64_t piece,
                         const SE3& T_world_start)
    : options_(options.backend), mapper_(options, map, piece, T_world_start) {}

void PieceMapper::TakeInDueSolve() {
  if (!pending_ || frames_ < due_) return;
  const Stopwatch watch;
  TakeIn();
  hand_over_ms_ += watch.Milliseconds();
}

void PieceMapper::TakeIn() {
  background_.Wait();
  pending_ = false;
  SolveReport report;
  report.discarded = !mapper_.ApplySolve(result_) && result_.usable();
  report.frames = problem_.poses.size();
  report.planes = problem_.planes.size();
  report.observations = problem_.observations.size();
  report.result = std::move(result_);
  taken_in_.push_back(std::move(report));
}

RegisteredScan PieceMapper::Process(const MapperScan& scan, bool may_restart) {
  RegisteredScan frame = mapper_.Process(scan, may_restart);
  if (frame.ends == PieceEnd::kNone) ++frames_;
  return frame;
}

void PieceMapper::StartDueSolve() {
  const Stopwatch watch;
  if (!pending_ && mapper_.SolveDue()) {
    Solve();
    due_ = frames_ + options_.hand_over_lag_frames;
  }
  hand_over_ms_ += watch.Milliseconds();
  if (solved_) TakeInDueSolve();
}

void PieceMapper::FinishSolves() {
  if (pending_) TakeIn();
  if (!mapper_.SolvePossible()) return;
  Solve();
  TakeIn();
}

void PieceMapper::Solve() {
  problem_ = mapper_.PrepareSolve();
  pending_ = true;
  Start();
}

void PieceMapper::Start() {
  solved_ = false;
  background_.Start([this] {
    result_ = AdjustBundle(problem_, options_.solver);
    solved_ = true;
  });
}

std::vector<SolveReport> PieceMapper::TakeSolves() { return std::exchange(taken_in_, {}); }

double PieceMapper::TakeHandOverMs() { return std::exchange(hand_over_ms_, 0.0); }

void PieceMapper::Archive(StateArchive& a) {
  a(&mapper_, &frames_, &taken_in_, &pending_, &due_);
  if (!pending_) return;
  a(&problem_);
  if (a.reading()) Start();
}

}  // namespace lamina
