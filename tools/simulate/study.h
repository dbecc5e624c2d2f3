// A study: formulations of bundle adjustment on the same virtual scenes, while one property of the
// scenes is swept.
//
// Every formulation of a trial gets the same problem and the same, tight tolerance. All are judged
// by one COMMON cost, whatever they minimise themselves: the eigenvalue cost of plane_geometry.h
// (1/2 sum weight N lambda_3, the likelihood of the points given the poses), taken of the poses
// after each step, outside of the measured time.
//
//   best      the least common cost that any formulation of the trial met with, at any step
//   gap       (cost - best) / max(best, floor). The floor is the rounding error of the common cost
//             times 1e8, so that a gap of 1e-8 means something without noise, too
//   fits      the cost is no higher than at the true poses (but for 1e-6 of the scale above). The
//             global optimum never is, a wrong one hardly ever: whether a formulation that
//             minimises something else (eigen_factors, plane_landmarks) has found the right place,
//             too
//   success   fits, and gap < 1e-6
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <limits>
#include <string>
#include <vector>

#include "backend/bundle/formulations/registry.h"
#include "tools/simulate/scene.h"

namespace lamina {

enum class SweepKind { kPlanes, kPoses, kNoise, kPoints, kStart };
// Their names, in the order of the enumeration.
const std::vector<std::string>& SweepNames();
// "planes", "noise (m)", ...
std::string SweepLabel(SweepKind kind);
// What `lamina simulate` takes if no values are given.
std::vector<double> DefaultValues(SweepKind kind);
// Start errors are swept by their rotation, in degrees; translation goes along.
inline constexpr double kStartMetresPerDegree = 0.025;

// `base` with the swept property at `value`. Throws OptionError, naming value and rule.
SimulationOptions AtValue(SimulationOptions base, SweepKind kind, double value);

struct Sweep {
  SweepKind kind = SweepKind::kNoise;
  std::vector<double> values;
};

struct StudyOptions {
  std::vector<const Formulation*> formulations;
  std::vector<Sweep> sweeps;
  SimulationOptions base;
  int trials = 20;  // of each value
  std::uint64_t seed = 1;
  int max_iterations = 500;

  // Throws OptionError for anything that a run would refuse.
  void Check() const;
  // How many scenes there are to draw.
  std::size_t Scenes() const;
};

inline constexpr std::uint64_t kLargestSeed = (std::uint64_t{1} << 53) - 1;
// The seed of a trial's scene. That of the very first is the study's own: whichever trial of a
// study can be had again by itself, with its seed and its value as the only one. Below 2^53, so
// that every reader of numbers keeps it exact.
std::uint64_t SceneSeed(std::uint64_t study_seed, std::size_t value_index, int trial);

struct TrialResult {
  static constexpr double kNever = std::numeric_limits<double>::infinity();

  const Formulation* formulation = &CondensedFormulation();
  SweepKind sweep = SweepKind::kNoise;
  double value = 0.0;
  int trial = 0;
  std::uint64_t seed = 0;  // of the scene
  // Root mean squares over the poses after the first, against the truth; no alignment, since the
  // first pose is held at its truth.
  double rot_error_deg = 0.0, trans_error_m = 0.0;
  double cost = 0.0, cost_gap = 0.0;  // common cost of the final poses
  int iterations = 0;                 // steps tried
  double ms = 0.0;                    // wall time of the solve
  BundleResult::Status status = BundleResult::Status::kFailed;
  // At the first step with a gap of at most 1e-8, and the time until then; kNever if there is none.
  double iterations_to_optimum = kNever, ms_to_optimum = kNever;
  double truth_cost = 0.0;  // common cost of the true poses
  bool fits = false, success = false;
};

// Of one trial, a result for each formulation, in the order of the options.
using TrialSink = std::function<void(const std::vector<TrialResult>&)>;

// Trials run one after another (the solvers themselves use all threads), so that times mean
// something. Ends early, between two solves, once *stop is true; trials that have been begun by
// then are dropped.
void RunStudy(const StudyOptions& options, const TrialSink& sink, const std::atomic<bool>* stop);

struct PoseErrors {
  double rot_deg = 0.0, trans_m = 0.0;
};
PoseErrors ComparePoses(const std::vector<SE3>& estimate, const std::vector<SE3>& truth);

// The options of a solve in a study: so tight that what differs is the formulation.
BundleAdjusterOptions TightOptions(int max_iterations);

const char* StatusName(BundleResult::Status status);

}  // namespace lamina
