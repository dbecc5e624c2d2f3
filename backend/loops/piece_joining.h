// Pieces of the map that have seen the same place become one.
//
// Between pieces nothing tells where to look: no odometry, no drift that bounds it, and what
// repeats (houses of a row, doors of a corridor) fits in many places. So a join needs more than a
// loop within a piece does:
//
//     looked up     each submap among those of other pieces (place_lookup.h), and registered
//                   (submap_registration.h); what is not refused is a candidate
//     agreeing      candidates of two pieces that say the same T_a_b, up to the drift between
//                   them, are a group; its size is the number of submaps that found one
//     no rival      no other group of these pieces, which says something else, is more than half
//                   as large: where things repeat, several shifts fit
//     confirmed     two submaps or more in the group; a piece of a single submap may be joined by
//                   one loop that holds stricter gates, without any rival
//     surroundings  under the join, submaps beside one another are registered where it says they
//                   are: most must agree. These are loops, too
//
// The largest groups join first. What is joined is solved by SolveAnchorGraph, all pieces at once;
// a join none of whose loops survives is none. Each part lies in the frame of its first piece.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "backend/anchors/anchor_graph.h"
#include "backend/loops/loop_closure.h"
#include "backend/loops/loop_options.h"
#include "backend/submaps/submap.h"
#include "backend/submaps/work_sharing.h"
#include "core/map/voxel_map.h"
#include "frontend/matching/scan_matcher.h"

namespace lamina {

// A piece as its own loops have left it.
struct MapPiece {
  const std::vector<Submap>* submaps = nullptr;  // anchors as odometry has them; ids count on
  AnchorGraph graph;                             // present anchors, and all edges that count
};

struct JoinedPieces {
  // Of each piece: the first one that it is connected with, itself if there is none before it.
  std::vector<std::size_t> part;
  std::vector<std::size_t> first_submap;  // of each piece, in `graph`
  // All submaps of all pieces: anchors in the frame of their part, all edges that count.
  AnchorGraph graph;
  // Those compared between pieces, in the order of `to`, then `from`: positions in `graph`.
  std::vector<Loop> loops;
};

// Pieces in the order of their age. Look-ups and registrations are shared out over processes. Pure
// function; deterministic at any number of threads and processes. Throws OptionError.
JoinedPieces JoinPieces(const std::vector<MapPiece>& pieces, const LoopOptions& options,
                        const VoxelMapOptions& map, const ScanMatcherOptions& matcher,
                        const WorkSharing& sharing = {});

}  // namespace lamina
