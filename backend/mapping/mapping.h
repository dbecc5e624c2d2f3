// Mapping, from points to poses and a map: all of it behind one class, without files, configuration
// files or threads of the caller's.
//
//     Mapping mapping;                                  // options are plain structs
//     for (const Scan& scan : scans) {
//       const MappedScan mapped = mapping.Add(scan);    // status, pose as known now, covariance
//     }
//     mapping.Finish();                                 // one last bundle adjustment
//     mapping.map().ForEachSurface(2, [](const Surfel& surfel) { ... });
//
// What Add does with a scan, in this order:
//
//     decode     range filter, times of points, clusters by voxel         scan_decoder.h
//     hand over  poses and planes of a bundle adjustment that is due      piece_mapper.h
//     register   predict, deskew, match to the map, or search             odometry.h
//     keyframe   into the sliding window, its clusters into the map       mapper.h
//     final      poses that have left the window are handed on            final_poses.h
//     correct    the map, by what loops have found                        loop_track.h
//     find       where a piece of its own lies among older ones           place_search.h
//     solve      bundle adjustment of the window begins, if it is due     adjuster.h
//
// Bundle adjustment runs in threads of TBB and takes effect a fixed number of scans later. A scan
// that is localised leaves map and window as they are (localiser.h).
//
// Deterministic: the same scans and options give the same bits, however many threads there are
// (tbb::global_control bounds them), whether scans come one by one or are decoded ahead
// (pipeline.h). Memory does not grow with the number of scans: poses are handed on by
// MappingCallbacks::on_final_pose when nothing will change them any more, and the map keeps within
// map.budget_mb: what was not seen for longest goes to the VoxelStore or, without one, is lost.
// With a ByteStore loops take some 50 kB a submap, without one all that the submaps hold.
//
// With loops.enabled the map is made of submaps, and places that are visited again correct it
// (backend/loops/loop_track.h). A recording that was lost for too long, or begins where others have
// been, is looked for, as a piece of its own, in older pieces that no recording maps now, and once
// found goes on with the piece it was found in. All poses here stay those of odometry, in a frame
// that never jumps; MappedScan::T_map_world and loops()->Corrected() move them to where corrections
// have them.
//
// A recording (the scans of one clock and one sensor: a folder of an inbox) has odometry, window
// and open solve of its own, so scans of several may alternate and each gets the poses that it
// would get alone. It begins a piece of the map (VoxelMap), and another one when it was lost for
// too long: nothing is known of where one piece lies in the frame of another, and nothing of one is
// matched to another or drawn over it, until it is found there. To make its piece available, a
// recording is suspended once it is silent for half of backend.final_after_frames, or if its last
// stamp is 15 s before another one begins: its piece is closed, others may be found in it and go on
// with it, and later scans of the recording go on with it as well, or begin a new piece if another
// has taken its place. (Localising, all recordings are matched to the map that is there, from the
// same start; or, without one, as a piece of its own until the map shows where it is.) The number
// of recordings under way is bounded: when one more comes, the one that was silent longest is
// ended, and what comes of it later begins a new piece.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "backend/mapping/final_poses.h"
#include "backend/mapping/mapped_scan.h"
#include "backend/mapping/options.h"
#include "backend/mapping/report.h"
#include "backend/mapping/scan_decoder.h"
#include "core/geometry/scan.h"
#include "core/geometry/state_archive.h"
#include "core/map/voxel_map.h"

namespace lamina {

struct MapPlace;
struct FoundPlace;
struct MapperScan;
struct RegisteredScan;
struct SolveReport;
class LostSearches;
class Mapper;
class PieceLoops;
class PieceSearches;
class PlaceSearch;

// Not thread-safe, but for Decode.
class Mapping {
 public:
  // `store` gets parts of the map that leave memory (VoxelMap), `submaps` what the submaps of loops
  // hold (LoopTrack). Throws OptionError.
  explicit Mapping(const MappingOptions& options = {}, MappingCallbacks callbacks = {},
                   VoxelStore* store = nullptr, ByteStore* submaps = nullptr);
  ~Mapping();
  Mapping(const Mapping&) = delete;
  Mapping& operator=(const Mapping&) = delete;

  // The next scan. One that cannot be used (too few points, times of points that are none of a
  // sweep, a stamp that is not after the last) is skipped, which its record says: scans do not
  // throw. Stamps must increase within a recording: after ten scans in a row that were skipped for
  // that, and increase among themselves, the clock was set, and the next one begins a piece.
  // Without times of its points, deskewing by azimuth takes the first scan to last 0.1 s
  // (preparation.sweep_period_s says better). Throws std::logic_error for a scan with times for
  // some of its points alone, and after Finish().
  MappedScan Add(const Scan& scan, const std::string& recording = "");
  // The same of a scan that was decoded before.
  MappedScan Add(DecodedScan scan);
  // Scan i of a range that begins at `begin`, for Add. Thread-safe.
  DecodedScan Decode(const ScanSource& source, std::size_t begin, std::size_t i) const;

  // No more scans are to come: one last solve of every recording under way, then all poses are
  // final, and so are the corrections by loops. A second call does nothing.
  void Finish();

  // From now on scans are matched to the map and leave it as it is, the first one near this pose.
  void StartLocalising(const SE3& T_world_lidar);
  // The same without a start: each recording begins a piece of its own, which nothing connects to
  // the map, until these places show where it is (backend/localisation/place_search.h). From then
  // on its scans are matched to the map; one that is lost for long begins anew so. `places`: from
  // PlaceIndex::SpacingM() apart, of pieces of the map.
  void StartLocalising(const std::vector<MapPlace>& places);

  const MappingOptions& options() const { return options_; }
  const MappingCounts& counts() const { return counts_; }
  const VoxelMap& map() const { return map_; }
  VoxelMap& map() { return map_; }
  // Submaps, loops and corrections (backend/loops/piece_loops.h). Null unless loops.enabled, and
  // when localising.
  const PieceLoops* loops() const { return loops_.get(); }
  // Poses of the scans that are not final, as known now.
  void ShowOpenPoses(const FinalPoses::Visit& visit) const;
  // Points of the newest keyframe of the recording that the last scan was of.
  std::vector<Eigen::Vector3d> NewestKeyframe() const;

  // Waits for the solve that takes effect before the next scan, of whichever recording that is, and
  // takes it in. Without that it may or may not have taken effect: what is saved would depend on
  // the speed of the threads.
  void TakeInDueSolves();
  // All of the state but the map; in on_scan_done or between two scans, after TakeInDueSolves().
  // Reading starts the solve again that was under way, and needs the map as it was.
  void Archive(StateArchive& a);

 private:
  struct Recording;  // recording.h

  // Looks for the piece of a recording among the places of the map, or, while it maps, in older
  // pieces; once found, its scans are matched to that, or go on with it.
  void FindPlace(Recording* recording, const MappedScan& report);
  void FindInMap(Recording* recording, const MappedScan& report);
  void FindInOlderPieces(Recording* recording, const MappedScan& report);
  void TakeLook(const std::optional<FoundPlace>& found, const PlaceSearch& search,
                Recording* recording, const MappedScan& report);
  void GoOnAt(const FoundPlace& found, Recording* recording, const MappedScan& report);
  // Maps on in a piece that was closed, after these poses in its frame.
  void GoOnIn(std::int64_t piece, const Trajectory& last, Recording* recording);
  // Pieces older than that of the scan, mapped by no recording that is not silent, whose stamps are
  // all earlier: those of a piece ascend.
  std::vector<std::int64_t> SilentPiecesBefore(const MappedScan& scan) const;
  bool IsSilent(const Recording& recording, std::size_t scan) const;
  // Suspends the recordings that map these pieces, so that the pieces change no more.
  void Rest(const std::vector<std::int64_t>& pieces, std::size_t scan);
  bool IsMapped(std::int64_t piece) const;
  // Resumes a suspended recording; false if there is no room for the piece that it must begin.
  bool Wake(Recording* recording);
  // Null if the map has no room for another piece.
  Recording* FindOrBegin(const MappedScan& report);
  // A piece of its own; localising from a start, the one that is there.
  void BeginPiece(const SE3& T_world_start, Recording* recording);
  void EndLongestSilent(std::size_t scan);
  // The map stays as it is: neither loops nor lost scans are looked for in it.
  void EndLoops();
  // Nothing more comes of this recording in its piece.
  void End(Recording* recording, std::size_t scan);
  // Marks the poses of its piece so far as not certain: they are of a start that is given up now,
  // or nothing determines their motion.
  void GiveUpStart(Recording* recording);
  // Skips a scan whose stamp is not after that of the last one, unless so many of those before were
  // skipped for it that the clock was set, and one that is of the same sweep as the last.
  void CheckStamp(Recording* recording, double sweep_s, MappedScan* report);
  bool ClockWasSet(StampNs stamp_ns, Recording* recording) const;
  // Whether the scans with later stamps that came before this one had wrong ones.
  static bool WasAhead(StampNs stamp_ns, const Recording& recording);
  void Map(Recording* recording, MappedScan* report, std::vector<TimedCluster>* clusters);
  RegisteredScan Register(Recording* recording, MappedScan* report,
                          std::vector<TimedCluster>* clusters);
  // Begins the piece after the one that `scan` has ended.
  void BeginNextPiece(const RegisteredScan& last, std::size_t scan, Recording* recording);
  // Makes the mapper of its piece, which hands on keyframes that leave the window.
  void MakeMapper(const SE3& T_world_start, Recording* recording);
  void ForwardFinalKeyframes(Mapper* mapper);
  // Corrects the map of a piece, when a correction by loops takes effect.
  void CorrectMap(std::int64_t piece);
  void SolveSilent(std::size_t scan);
  std::int64_t SilentScans() const;
  void HandOnFinalPoses(std::size_t scan);
  void CountSolves(std::vector<SolveReport> solves, std::size_t before_scan);
  FinalPoses::Visit Visitor() const;
  void ArchiveRecording(StateArchive& a, Recording* recording);
  void ArchiveSearches(StateArchive& a);

  const MappingOptions options_;
  MappingCallbacks callbacks_;
  VoxelMap map_;
  MappingCounts counts_;
  FinalPoses poses_;
  std::optional<SE3> localise_from_;
  std::unique_ptr<PieceSearches> searches_;  // null unless localising without a start
  FinalPoses::Stream next_stream_ = 0;
  std::string newest_;  // recording
  bool finished_ = false;
  std::unique_ptr<PieceLoops> loops_;
  std::unique_ptr<LostSearches> lost_searches_;  // null where loops_ is
  std::unique_ptr<std::map<std::string, Recording>> recordings_;
  // The last stamps of each recording that Add(Scan) has seen; they tell the period of a sweep.
  std::map<std::string, std::vector<StampNs>> stamps_;
};

}  // namespace lamina
