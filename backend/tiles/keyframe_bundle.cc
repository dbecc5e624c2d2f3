#include "backend/tiles/keyframe_bundle.h"

#include <iomanip>
#include <sstream>

#include "backend/registration/batch_cast.h"
#include "backend/submaps/association_rounds.h"
#include "backend/tiles/tiled_model.h"
#include "core/base/stopwatch.h"

namespace lamina {
namespace {

// What is done when keyframes move by less, root mean square.
constexpr double kSettledM = 0.0005, kSettledRad = 5e-5;

class KeyframeBundle {
 public:
  KeyframeBundle(const KeyframeSource& keyframes, const BundleProblem& ties,
                 const KeyframeBundleOptions& options, const VoxelMapOptions& map,
                 const SlidingWindowOptions& weights, const WorkSharing& sharing,
                 const MakeStore& make_store)
      : keyframes_(keyframes),
        ties_(ties),
        options_(options),
        map_(map),
        weights_(weights),
        sharing_(sharing),
        make_store_(make_store) {}

  KeyframeBundleResult Run() {
    result_.poses = ties_.poses;
    const std::vector<SE3> start = ties_.poses;
    for (int round = 0; round < options_.rounds; ++round) {
      if (!Round(round)) break;
      const KeyframeRound& last = result_.rounds.back();
      if (round > 0 && last.moved_m < kSettledM && last.moved_rad < kSettledRad) break;
    }
    if (result_.rounds.empty()) return result_;
    result_.initial_misfit_m = MisfitAt(start);
    result_.final_misfit_m = MisfitAt(result_.poses);
    if (result_.final_misfit_m >= result_.initial_misfit_m) {
      result_.poses = start;
      std::ostringstream text;
      text << std::setprecision(4) << "its map is no better: " << 1e3 * result_.final_misfit_m
           << " against " << 1e3 * result_.initial_misfit_m << " mm from its planes";
      result_.refusal = text.str();
    }
    return result_;
  }

 private:
  // False if its poses do not count.
  bool Round(int number) {
    KeyframeRound round;
    Stopwatch watch;
    TiledProblem::Options options{map_, weights_,
                                  static_cast<std::size_t>(options_.most_observations)};
    if (number == 0) options.map.max_thickness_m *= kFirstRoundThickness;
    options.map = WithinRange(options.map);
    const TiledClusters clusters(keyframes_, result_.poses, options.map, options_.tile_size_m,
                                 sharing_, make_store_);
    const TiledProblem problem(clusters, result_.poses, options, sharing_, make_store_);
    result_.tiles = clusters.size();
    round.planes = problem.planes();
    round.observations = problem.observations();
    if (round.planes < static_cast<std::uint64_t>(kRoundSolver.min_planes)) {
      result_.refusal = "too few planes are seen by two keyframes or more";
      return false;
    }
    ties_.poses = result_.poses;
    TiledModel model(problem, ties_, sharing_);
    round.build_s = 1e-3 * watch.LapMilliseconds();
    const BundleResult solved =
        MinimiseInTrustRegion(ties_.poses, kRoundSolver, nullptr, /*may_keep=*/false, &model);
    round.solve_s = 1e-3 * watch.LapMilliseconds();
    if (!solved.usable()) {
      result_.refusal = "the solver failed";
      return false;
    }
    round.blocks = model.blocks();
    round.bytes_received = model.bytes_received();
    round.iterations = solved.iterations;
    round.initial_cost = solved.initial_cost;
    round.final_cost = solved.final_cost;
    const PoseMoves moves = MovesBetween(ties_.poses, solved.poses);
    if (moves.largest_m > map_.root_size_m) {
      result_.refusal = "a keyframe was carried farther than a voxel";
      return false;
    }
    round.moved_m = moves.rms_m;
    round.moved_rad = moves.rms_rad;
    result_.rounds.push_back(round);
    result_.poses = solved.poses;
    return true;
  }

  double MisfitAt(const std::vector<SE3>& poses) const {
    const OtherVoxels other(map_, poses);
    const TiledClusters clusters(keyframes_, other.poses, other.map, options_.tile_size_m, sharing_,
                                 make_store_);
    return TiledMisfit(clusters, other.poses, other.map, weights_, sharing_);
  }

  const KeyframeSource& keyframes_;
  BundleProblem ties_;
  const KeyframeBundleOptions options_;
  const VoxelMapOptions& map_;
  const SlidingWindowOptions& weights_;
  const WorkSharing& sharing_;
  const MakeStore& make_store_;
  KeyframeBundleResult result_;
};

}  // namespace

void KeyframeBundleOptions::Visit(OptionVisitor& v) {
  v.Integer("rounds", &rounds, 1, 100);
  v.Number("tile_size_m", &tile_size_m, 1.0, 10000.0);
  v.Integer("most_observations", &most_observations, 0, 1000000);
}

KeyframeBundleResult AdjustKeyframes(const KeyframeSource& keyframes, const BundleProblem& ties,
                                     const KeyframeBundleOptions& options,
                                     const VoxelMapOptions& map,
                                     const SlidingWindowOptions& weights,
                                     const WorkSharing& sharing, const MakeStore& make_store) {
  CheckOptions(options, "keyframes");
  return KeyframeBundle(keyframes, ties, options, map, weights, sharing, make_store).Run();
}

}  // namespace lamina
