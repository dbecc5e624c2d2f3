// Poses of scans in their order, each handed on once it is final.
//
// Scans come in one by one, with a pose of their own to follow or without (skipped). Poses come
// later, when bundle adjustment is done with them, in *streams*: those of one stream (a mapper, a
// piece of the map) come in the order of its scans, streams do not wait for one another. A skipped
// scan gets a pose between those of its neighbours in the stream: by stamp where that is possible,
// else the one before it (for the first scans: after).
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <functional>
#include <limits>
#include <map>

#include "core/geometry/scan.h"
#include "core/geometry/state_archive.h"

namespace lamina {

struct FinalPose {
  std::size_t scan = 0;  // its number, as given to AddScan
  StampedPose pose;
  bool skipped = false;    // the pose is not of its own points
  std::int64_t piece = 0;  // of the map, in the frame of whose odometry it is
  // Whether it is of a start that was given up (frontend/start/start_track.h): no motion explains
  // its scans, and the pose may be off by any part of the way.
  bool given_up = false;
};

// Not thread-safe. Memory: the scans that are not final, and the streams that are not closed.
class FinalPoses {
 public:
  using Visit = std::function<void(const FinalPose&)>;
  using Stream = std::int64_t;

  // `piece` is that of the stream.
  void AddScan(std::size_t scan, StampNs stamp_ns, bool skipped, Stream stream = 0,
               std::int64_t piece = 0);
  // The next poses of a stream, of its scans that were not skipped.
  void AddPoses(const Trajectory& poses, Stream stream = 0);
  // Marks the scans of a stream that are not handed on and have this stamp or a later one as
  // skipped, with the pose before them: their stamps were wrong.
  void Disown(Stream stream, StampNs from_ns);
  // Marks the scans of a stream that are not handed on as those of a start that was given up.
  // Returns their number.
  std::size_t GiveUp(Stream stream);
  // No more scans and poses come in this stream.
  void Close(Stream stream);
  // Hands on what is final, in order. A skipped scan with a number below `before_scan` does not
  // wait any longer for the scan after it.
  void HandOn(std::int64_t before_scan, const Visit& visit);
  // Visits the scans that are left, with the poses that are still open by stream, as if nothing
  // were to come.
  void ShowOpen(const std::map<Stream, Trajectory>& open, const Visit& visit) const;

  void Archive(StateArchive& a);

 private:
  struct Scan {
    std::size_t number = 0;
    StampNs stamp_ns = 0;
    bool skipped = false;
    Stream stream = 0;
    std::int64_t piece = 0;
    bool posed = false;  // T is its own
    SE3 T;
    bool given_up = false;
    bool disowned = false;
  };
  struct Past {
    bool any = false;
    StampedPose last;       // the last final pose of a scan's own, if any
    std::int64_t open = 0;  // scans that are not handed on
    bool closed = false;
  };
  // The next scan of the first open scan's stream, skipped ones left out; null if there is none.
  const Scan* NextOfStream() const;
  // Gives the first open scan its pose; false if it must wait. `late`: a skipped one does not wait.
  bool PoseFirst(bool late);

  std::deque<Scan> open_;
  std::map<Stream, Past> past_;
};

}  // namespace lamina
