// The pieces of a run when all scans are mapped: those that have seen the same place are joined
// (backend/loops/piece_joining.h), anchors adjusted by the planes that submaps share
// (backend/submaps/submap_bundle.h), and map and poses moved with their submaps.
//
// What is joined lies in the frame of its first piece, which is called its frame here.
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "backend/loops/loop_closure.h"
#include "backend/loops/piece_joining.h"
#include "backend/submaps/submap_bundle.h"
#include "config/config.h"
#include "tools/results/submap_file.h"

namespace lamina {

class JoinedRun {
 public:
  using Pieces = std::map<std::int64_t, const LoopClosure*>;

  // The pieces, by number, must outlive it.
  JoinedRun(Pieces pieces, const LaminaConfig& config);

  // Whether any loop was accepted: if not, nothing is moved.
  bool moved() const;
  std::int64_t FrameOf(std::int64_t piece) const;
  // The pieces that have another's frame.
  std::map<std::int64_t, std::int64_t> joins() const;
  SE3 Corrected(std::int64_t piece, StampNs stamp_ns, const SE3& T_world_lidar) const;
  // All submaps at their anchors, into an empty map, each frame a piece of it.
  void AddTo(VoxelMap* map) const;

  const Pieces& pieces() const { return pieces_; }
  // Positions in it are those of pieces().
  const JoinedPieces& joined() const { return joined_; }
  const SubmapBundleResult& bundle() const { return bundle_; }
  // Those of joined().graph that lie in this frame.
  std::vector<std::size_t> SubmapsOfFrame(std::int64_t frame) const;
  // For submaps.bin.
  std::vector<SubmapFrameView> Frames() const;
  // The piece of a submap of joined().graph.
  std::int64_t PieceOfSubmap(std::size_t submap) const;
  // Its number in that piece.
  std::size_t NumberInPiece(std::size_t submap) const;

 private:
  void AddTrimmed(const std::vector<std::size_t>& submaps, SubmapFrameView* frame) const;
  void Adjust(const std::vector<MapPiece>& parts, const LaminaConfig& config);
  std::size_t PositionOf(std::int64_t piece) const;

  Pieces pieces_;
  std::vector<std::int64_t> numbers_;
  JoinedPieces joined_;
  SubmapBundleResult bundle_;
  std::map<std::int64_t, std::vector<SE3>> anchors_;
  std::map<std::int64_t, AnchorCorrection> corrections_;
};

// Adds the column `frame` to frames.csv: the piece in whose frame the pose is. Throws OutputError.
void AddFrameColumn(const std::string& frames_csv,
                    const std::map<std::int64_t, std::int64_t>& joins);

}  // namespace lamina
