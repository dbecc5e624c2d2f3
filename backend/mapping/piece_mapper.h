// The mapper of a piece, and the bundle adjustment that is under way for it in the background.
//
// A solve starts after a frame and takes effect a fixed number of frames of the same piece later,
// never "when it is ready": how fast threads are, and what other recordings do, decides nothing.
//
// Private to backend/mapping.
#pragma once

#include <atomic>
#include <cstdint>
#include <vector>

#include "backend/mapping/report.h"
#include "backend/pieces/mapper.h"
#include "core/base/parallel.h"

namespace lamina {

// Not thread-safe.
class PieceMapper {
 public:
  PieceMapper(const MapperOptions& options, VoxelMap* map, std::int64_t piece,
              const SE3& T_world_start);

  // Before a scan of any recording is mapped: takes in the solve whose time has come.
  void TakeInDueSolve();
  RegisteredScan Process(const MapperScan& scan, bool may_restart);
  // After it, when no caller waits for the pose any more: starts the next solve, and takes one in
  // that is due before the next scan if it is there already.
  void StartDueSolve();
  // Takes in the solve under way, then runs one last solve that includes the newest frames.
  void FinishSolves();
  // Solves taken in since the last call.
  std::vector<SolveReport> TakeSolves();
  // Wall time of all that since the last call.
  double TakeHandOverMs();

  Mapper& mapper() { return mapper_; }
  const Mapper& mapper() const { return mapper_; }

  // All but the piece's number. Reading starts the solve again that was under way.
  void Archive(StateArchive& a);

 private:
  void Solve();
  void Start();
  void TakeIn();

  const BackendOptions options_;
  Mapper mapper_;
  std::int64_t frames_ = 0;
  bool pending_ = false;
  std::int64_t due_ = 0;  // takes effect before this frame
  std::vector<SolveReport> taken_in_;
  double hand_over_ms_ = 0.0;
  BundleProblem problem_;
  BundleResult result_;
  std::atomic<bool> solved_{false};
  Background background_;  // the last member: it waits before what it works on goes
};

}  // namespace lamina
