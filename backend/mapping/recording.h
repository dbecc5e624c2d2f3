// One recording of those that a mapping has under way: how far it has come, and what maps or
// localises its scans.
//
// Private to backend/mapping.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>

#include "backend/mapping/final_poses.h"
#include "backend/mapping/mapping.h"
#include "backend/mapping/piece_mapper.h"
#include "backend/pieces/localiser.h"
#include "core/geometry/scan.h"

namespace lamina {

struct Mapping::Recording {
  bool any = false;  // scan that was not skipped
  StampNs last_stamp_ns = 0;
  // Stamps of the last scan that was not lost, and of the first one that was lost after it.
  StampNs matched_stamp_ns = 0, lost_stamp_ns = 0;
  bool lost = false;
  std::string last_sensor;
  // Scans in a row that were skipped as their stamps are not after that, and the stamp of the
  // newest of them.
  std::int64_t not_after = 0;
  StampNs not_after_ns = 0;
  std::int64_t last_scan = 0;  // skipped or not
  bool over = false;           // considered silent because a later recording began; cleared by its
                               // next scan
  std::int64_t piece = 0;      // that its scans are matched to now
  FinalPoses::Stream stream = 0;
  std::size_t certain = 0;  // scans of this one that are tracked, not degenerate
  Trajectory last;          // the last poses before it fell silent, which tell its motion
  // What processes its scans: a mapper if the piece is being made, a localiser if it stays as it
  // is. None while the recording is suspended.
  std::unique_ptr<PieceMapper> mapper;
  std::unique_ptr<Localiser> localiser;

  bool rests() const { return mapper == nullptr && localiser == nullptr; }
  RegisteredScan Process(const MapperScan& scan, bool may_restart);
  Trajectory TakeFinal(std::int64_t before_scan);
  Trajectory OpenPoses() const;
  // The last of the open poses, which tell the motion.
  Trajectory LastPoses() const;
};

}  // namespace lamina
