// Registration of a whole batch of scans from initial poses (Huang et al. 2021, Algorithm 1).
//
// A round casts all clusters into a voxel map at the present poses, keeps the voxels that hold a
// plane (enough points, ratio of eigenvalues, VoxelMapOptions) seen by two frames or more, weighs
// the clusters (cap, robust kernel) and solves the bundle problem until it converges. A plane that
// is seen from both sides is two, the faces of a wall (batch_cast.h). The next round
// associates anew. Rounds go from coarse voxels to fine ones when the start is poor:
//
//     root size of round i = map.root_size_m * (coarse / map.root_size_m)^left,
//     left = max(0, 1 - i / (rounds - 2))
//
// and end early when a round at the final size hardly moves the poses any more. A coarse round
// needs no finer clusters than its own leaves: they are merged, by the power of two nearest to its
// size.
//
// Links between frames that solves have carried farther than a voxel of the first round are cut
// (frame_links.h): what made them was no plane of both.
//
// What cannot be determined (observability.h) stays at the initial poses and is reported; the rest
// is solved. Nothing at all to solve is a refusal. Groups of frames that slide as one are held in
// the rounds at the final size alone: planes that poor poses part are still to be joined by the
// coarse ones. Whatever earlier rounds moved it by along open directions is undone. All of a group
// that slides get the variance of an open direction along its motion.
//
// At the end another judge compares the result with the initial poses: the misfit of all clusters
// on planes of voxels of another size at other places (batch_cast.h), each cluster counting as much
// as any other. What the adjustment has been misled by, such as traffic with many points or
// associations of its own making, is no better there; then the initial poses are the result.
#pragma once

#include <atomic>
#include <functional>
#include <string>
#include <vector>

#include "backend/bundle/solver/adjuster.h"
#include "backend/bundle/solver/formulation.h"
#include "backend/bundle/uncertainty/observability.h"
#include "backend/registration/batch_frame.h"
#include "backend/window/sliding_window.h"
#include "core/map/voxel_map.h"
#include "core/options/options.h"

namespace lamina {

class FrameLinks;

struct RegistrationOptions {
  // Association rounds at most.
  int rounds = 8;
  // Root size of the first round; 0: as map.root_size_m.
  double coarse_root_size_m = 0.0;
  // Converged when a round at the final size moves the poses by less, root mean square.
  double min_rotation_change_deg = 0.01;
  double min_translation_change_m = 0.001;
  BundleAdjusterOptions solver = {50, 1e-8, 6};
  ObservabilityOptions observability;

  void Visit(OptionVisitor& v);
};

struct RoundReport {
  int round = 0;  // from 0
  double root_size_m = 0.0;
  std::size_t planes = 0, observations = 0;
  double initial_cost = 0.0, final_cost = 0.0;
  int iterations = 0;
  // A frame was carried farther than a voxel, where its associations mean nothing: the round was
  // solved again with such frames held, or such links cut.
  bool leapt = false;
  double build_ms = 0.0, solve_ms = 0.0;  // map and problem / the solver alone
};

struct RegistrationResult {
  enum class Status {
    kConverged,
    kRoundLimit,  // usable
    kPartial,     // some of it could not be determined: see faults
    kNoBetter,    // the initial poses fit as well or better, and are the result: see reason
    kIllPosed,    // refused; poses are those of the last good round, or the initial ones
    kFailed,      // numerical failure; poses are those of the last good round
    kInterrupted,
  };
  Status status = Status::kIllPosed;
  std::string reason;  // of a refusal, a failure or a result that is no better
  std::vector<SE3> poses;
  std::vector<BundleFault> faults;  // of the last round
  std::vector<RoundReport> rounds;
  // By the other judge, metres; of what the rounds have led to, even if that was no better.
  double initial_misfit_m = 0.0, final_misfit_m = 0.0;
  // pose_covariance.h, of the last round; empty if there are none, since nothing was solved or for
  // this reason.
  std::vector<Matrix6d> covariances;
  std::string covariance_failure;
};
const char* ToString(RegistrationResult::Status status);

struct RegistrationCallbacks {
  std::function<void(const RoundReport&, const BundleStep&)> on_step;
  std::function<void(const RoundReport&)> on_round;
  // Once, with all of the result but the covariances, which may need more memory than there is.
  std::function<void(const RegistrationResult&)> on_poses;
};

class BatchRegistration {
 public:
  // Throws OptionError. `formulation` must outlive it.
  BatchRegistration(const RegistrationOptions& options, const VoxelMapOptions& map,
                    const SlidingWindowOptions& weights,
                    const Formulation& formulation = CondensedFormulation());

  // Ends after the solver's present round once `stop` is true. Deterministic at any number of
  // threads.
  RegistrationResult Run(const std::vector<BatchFrame>& frames,
                         const RegistrationCallbacks& callbacks,
                         const std::atomic<bool>* stop = nullptr) const;

  // The map of the frames at these poses, at the final size.
  void VisitSurfels(const std::vector<BatchFrame>& frames, const std::vector<SE3>& poses,
                    int min_frames, const std::function<void(const Surfel&)>& visit) const;

  // Root size of round i.
  double RootSize(int round) const;
  // Edge of the voxels to which clusters are merged for round i, in leaves of the final size.
  int MergeFactor(int round) const;

 private:
  // All but the covariances; *problem is that of the last round.
  RegistrationResult Solve(const std::vector<BatchFrame>& frames,
                           const RegistrationCallbacks& callbacks, const std::atomic<bool>* stop,
                           BundleProblem* problem) const;
  // By voxels that no round has.
  double MisfitAt(const std::vector<BatchFrame>& frames, const std::vector<SE3>& poses) const;
  // Puts the initial poses in the place of a result that fits worse.
  void JudgeAgainstStart(const std::vector<BatchFrame>& frames, RegistrationResult* result) const;
  BundleProblem CastRound(const std::vector<BatchFrame>& frames, const std::vector<SE3>& poses,
                          double root_size_m) const;
  // Solves, and once more without the frames that leapt. *swings: frames may go any way as long as
  // no link is carried farther than a voxel; false from the first that is.
  BundleResult SolveRound(const RegistrationCallbacks& callbacks, const FrameLinks& links,
                          BundleProblem* problem, bool* swings, RoundReport* report,
                          std::vector<BundleFault>* faults) const;

  RegistrationOptions options_;
  VoxelMapOptions map_;
  SlidingWindowOptions weights_;
  const Formulation& formulation_;
};

}  // namespace lamina
