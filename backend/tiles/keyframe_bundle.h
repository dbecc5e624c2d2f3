// The first level of bundle adjustment over a whole map: all keyframes of all drives at once, out
// of core, over many processes.
//
//     min_T  sum_planes 1/2 weight N lambda_3(Sigma(T)) + 1/2 sum_priors |r|^2
//
// As the second level (backend/submaps/submap_bundle.h), with keyframes in the place of submaps:
// anchors are right by then, but each submap is as stiff as the window left it. A round sorts all
// clusters into tiles at the present poses, makes each tile's planes, and solves
// (backend/tiles/tiled_model.h). The first round takes planes of twice the thickness for planes.
//
// At the end another judge compares the poses with those of the start: the misfit of all clusters
// on planes of voxels of another size at other places (backend/registration/batch_cast.h). If it
// is no better, the start is the result.
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "backend/bundle/problem.h"
#include "backend/submaps/work_sharing.h"
#include "backend/tiles/keyframe_source.h"
#include "backend/window/sliding_window.h"
#include "core/map/voxel_map.h"

namespace lamina {

struct KeyframeBundleOptions {
  // Rounds of association at most.
  int rounds = 5;
  // Edge of a tile of space, of which a process holds some in memory.
  double tile_size_m = 40.0;
  // Observations of a plane that take part one by one; more are summed with their neighbours in
  // time. 0: any number.
  int most_observations = 0;

  void Visit(OptionVisitor& v);
};

struct KeyframeRound {
  std::uint64_t planes = 0, observations = 0;
  std::size_t blocks = 0;            // of H, on the first process
  std::uint64_t bytes_received = 0;  // by it
  int iterations = 0;
  double initial_cost = 0.0, final_cost = 0.0;
  double moved_m = 0.0, moved_rad = 0.0;  // root mean square of the keyframes
  // Wall times; nothing depends on them.
  double build_s = 0.0, solve_s = 0.0;
};

struct KeyframeBundleResult {
  std::vector<SE3> poses;
  std::vector<KeyframeRound> rounds;
  std::size_t tiles = 0;  // of the last round
  double initial_misfit_m = 0.0, final_misfit_m = 0.0;
  std::string refusal;  // why the poses are those of the start, if they are
};

// `ties.poses`: of the keyframes, the start; `ties.priors`: between them; its first pose is held,
// and it has no planes. All processes of `sharing` call it together and get the same result, whose
// bits do not depend on how many they are, nor on threads. Throws OptionError, and what `keyframes`
// and stores throw.
KeyframeBundleResult AdjustKeyframes(const KeyframeSource& keyframes, const BundleProblem& ties,
                                     const KeyframeBundleOptions& options,
                                     const VoxelMapOptions& map,
                                     const SlidingWindowOptions& weights,
                                     const WorkSharing& sharing, const MakeStore& make_store);

}  // namespace lamina
