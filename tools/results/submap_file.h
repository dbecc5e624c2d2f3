// submaps.bin: the submaps of a run, by frame, with their anchors and the graph that holds them
// (backend/submaps): what `merge` and `refine` go on from.
//
// A file of sections (io/file/section_file.h):
//
//     "FRAM"   u64 number of the frame, u64 number of its submaps; anchors; edges of odometry,
//              edges of loops
//     "TRIM"   only where there are any, after the frame's: the trimmed submaps of its pieces
//              (backend/loops/anchor_correction.h), with their pieces; holders by position in the
//              frame
//     "SUBM"   a submap of the frame before: piece, number in the piece, leaf size, its anchor as
//              odometry has it, way; keyframes; leaves of 48 bytes each
//
// Read back to the last bit.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "backend/anchors/anchor_graph.h"
#include "backend/loops/loop_closure.h"
#include "backend/submaps/submap.h"

namespace lamina {

inline constexpr const char* kSubmapFileName = "submaps.bin";

// Of the pieces of a frame; holders are positions in the frame.
using FrameTrimmings = std::map<std::int64_t, std::vector<TrimmedSubmap>>;
// With holders so many positions later.
std::vector<TrimmedSubmap> Shifted(std::vector<TrimmedSubmap> trimmed, std::ptrdiff_t positions);

// Submaps whose anchors are in one frame.
struct SubmapFrame {
  std::int64_t frame = 0;            // the first piece that it holds
  std::vector<std::int64_t> pieces;  // of each submap
  std::vector<Submap> submaps;       // of each piece in order, anchors as odometry has them
  AnchorGraph graph;                 // present anchors, and the edges that count
  FrameTrimmings trimmed;
};

// A view of the same for writing.
struct SubmapFrameView {
  std::int64_t frame = 0;
  std::vector<std::int64_t> pieces;
  std::vector<const Submap*> submaps;
  AnchorGraph graph;
  FrameTrimmings trimmed;
};

// Of pieces that nothing joins, each a frame; they must outlive it.
std::vector<SubmapFrameView> FramesOf(const std::map<std::int64_t, const LoopClosure*>& pieces);

// Throws OutputError.
void WriteSubmaps(const std::string& path, const std::vector<SubmapFrameView>& frames);

// Throws InputError, naming the file, the submap and the rule: what is damaged, of another version,
// or cannot be (numbers that are not finite, leaves out of order, edges of submaps that there are
// not).
std::vector<SubmapFrame> ReadSubmaps(const std::string& path);

}  // namespace lamina
