// The sensor of one recording in one piece of the map: odometry, and the track of its scans while
// it is lost. A Mapper makes the map from what this finds; a Localiser leaves it as it is.
#pragma once

#include <cstdint>
#include <vector>

#include "backend/pieces/mapper_options.h"
#include "core/geometry/scan.h"
#include "core/geometry/state_archive.h"
#include "core/map/voxel_map.h"
#include "frontend/odometry/lost_track.h"
#include "frontend/odometry/odometry.h"

namespace lamina {

// A scan as a mapper takes it.
struct MapperScan {
  std::int64_t number = 0;  // increases from scan to scan, and so does the stamp
  StampNs stamp_ns = 0;
  bool stamp_made_up = false;                     // Scan::stamp_made_up
  std::vector<TimedCluster>* clusters = nullptr;  // taken if the scan becomes a keyframe
  // Reference instant of the scan (SweepMotion), ns after its stamp: the clusters' times count from
  // it. Poses in the window are those at that instant, the middle of the sweep: motion within the
  // scan that is not steady shifts a point by acceleration * time^2 / 2, which is four times as
  // much from one end.
  StampNs middle_ns = 0;
};

// Why a scan ends a piece of the map. It is left out of that piece, and begins the next one.
enum class PieceEnd {
  kNone,  // it does not
  // The next scans have no known place in this piece, and are not in its map: the start was given
  // up; or the sensor is lost and the last scans agree with one another, as those of rain and spray
  // do not; or no scan was ever matched, or more in a row are lost than were tracked; or the clock
  // was set back.
  kUnconnected,
  // The sensor is tracked, but its place against what was mapped before is unknown. The next piece
  // begins with the keyframes before this scan.
  kContinued,
};

struct RegisteredScan {
  OdometryFrame odometry;
  bool keyframe = false;
  PieceEnd ends = PieceEnd::kNone;
  bool start_uncertain = false;  // nothing determines the motion of this piece's scans so far
};

// Not thread-safe; deterministic.
class ScanTracker {
 public:
  // Takes those of `options` that say how scans are matched, and when a lost one is to begin a
  // piece.
  explicit ScanTracker(const MapperOptions& options);

  // Forgets the motion, and continues these poses.
  void StartAfter(const Trajectory& last);

  // Takes over what another one knows of the motion and of how scans fit.
  void GoOnFrom(const ScanTracker& before) { odometry_.GoOnFrom(before.odometry_); }

  // Pose of a scan, its stamp that of the middle of its sweep. Brings back what the map had where
  // the scan is expected, and leaves it as it is. `map_is_older` than the drive: see Odometry.
  OdometryFrame Register(StampNs stamp_ns, bool stamp_made_up,
                         const std::vector<TimedCluster>& clusters, VoxelMap* map,
                         bool map_is_older);
  // Takes in the outcome of Register: one of these two.
  void Accept(const OdometryFrame& frame);
  void Lose(const OdometryFrame& frame, const std::vector<TimedCluster>& clusters);

  bool lost() const { return odometry_.lost(); }
  // Whether a lost scan is to begin a piece of its own. `matched`: a scan was ever tracked in the
  // map.
  bool MayRestart(bool matched) const;
  // Whether more scans in a row are lost than were ever tracked, and enough to begin a piece: a map
  // of a few scans is not worth waiting for longer, though those that are lost do not agree.
  bool LostLongerThanTracked() const;

  Odometry& odometry() { return odometry_; }
  // Forgets the motion and the lost track.
  void StartOver();

  void Archive(StateArchive& a);

 private:
  // Register of a scan that follows a lost one.
  OdometryFrame FindAgain(StampNs stamp_ns, const std::vector<TimedCluster>& clusters,
                          const VoxelMap& map);

  Odometry odometry_;
  LostTrack lost_track_;
  int restart_after_lost_frames_;
  bool pieces_are_found_;
  int lost_in_a_row_ = 0;
  std::int64_t tracked_ = 0;
};

}  // namespace lamina
