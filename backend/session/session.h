// A mapping session: a Mapping, and a folder in which nothing that it has done is lost.
//
//     session.db          every scan with its pose, every window solved
//                         (io/store/session_database.h)
//     session.db.backup   the same as of a checkpoint, in case the first is damaged
//     checkpoint-N.lmap   all of the mapping after scan N - 1. The newest two are kept, and the
//                         newest that session.db.backup knows all scans of
//     map_tiles.db        what the map's budget does not hold in memory (io/store/tile_store.h)
//     trajectory_kitti.txt, trajectory_tum.txt
//                         kept current (backend/session/trajectory_files.h)
//     lock                held while a process works on the session (exclusive), or copies its map
//                         to localise in it (shared)
//
// A scan is *durable* when its row is on disk; its file may be called done. Poses follow when the
// window has passed (final). Checkpoints are written beside the mapping: the state is copied at one
// moment, the map piece by piece while it goes on changing (VoxelMap), and the file appears whole.
//
// With loops.enabled the trajectory files have the corrected poses, the database those of odometry,
// and a checkpoint all submaps.
//
// To continue, the newest undamaged checkpoint is loaded, the tiles go back to what they were then,
// and the scans recorded after it are mapped again, from their files, in the recorded order. So the
// result is the same, bit for bit, as if the session had never been interrupted.
//
// A checkpoint is a checkpoint file (io/store/checkpoint_file.h) of these sections:
//
//     HEAD   u64 number of scans in it, string: the options that decide results, u64 number of
//            records in map_tiles.db
//     MAPC   counters of the map          (VoxelMap::ArchiveCounters)
//     PIPE   of each recording under way its window, odometry, solve ...
//            (Mapping::Archive)
//     ROOT   roots of the map, any number of sections  (core/map/voxel_map_records.cc)
#pragma once

#include <atomic>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "backend/mapping/mapping.h"
#include "backend/session/checkpoint_writing.h"
#include "backend/session/folder.h"
#include "backend/session/log.h"
#include "backend/session/options.h"
#include "backend/session/trajectory_publisher.h"
#include "io/inbox/streamed_scans.h"
#include "io/store/session_database.h"
#include "io/store/tile_store.h"

namespace lamina {

// Any may be empty. on_durable is called on the log's thread, on_checkpoint on the housekeeping
// thread, the others on the mapping thread.
struct SessionHooks {
  // Before on_durable can be called for that scan; exactly for those for which it will be.
  std::function<void(const MappedScan&, const ScanRecord&)> on_mapped;
  std::function<void(const MappedScan&, const ScanRecord&)> on_scan;
  // Localising without a start: a look for a piece among the places of the map.
  OnPlaceReport on_look;
  // A pose that nothing will change any more; the scan may not be durable yet.
  std::function<void(const FinalPose&)> on_final;
  std::function<void(const ScanRecord&)> on_durable;
  // The files of scans before `released` will not be needed again, whatever happens.
  CheckpointWriting::OnCheckpoint on_checkpoint;
};

// One thread at a time, the mapping thread. Throws OutputError when the session's folder cannot be
// written: nothing that was durable is lost, and a session opened anew goes on from there. It is a
// DiskFullError (io/file/disk_room.h) where room is all that it wants; backend/session/room.h says
// how much.
class Session {
 public:
  // Opens or makes a session, and loads its newest checkpoint. Throws InputError if another process
  // works on it or on the map to localise in, or nothing in it can be used; OptionError for options
  // that differ from those it was begun with.
  Session(SessionSetup setup, SessionHooks hooks);

  // Number of the next scan: of those to be repeated, if there are any.
  std::int64_t next_scan() const { return next_; }
  // Recorded scans from next_scan() on; their files come first again.
  const std::vector<ScanRecord>& to_repeat() const { return to_repeat_; }
  // For questions to it (not for changes).
  const SessionDatabase& database() const { return *database_; }
  const Mapping& mapping() const { return *mapping_; }
  // Root voxels that are on disk and not in memory.
  std::size_t stored_roots() const { return tiles_->records(); }
  // For questions about tiles (VoxelMap::TrackTiles).
  void TrackTiles() { mapping_->map().TrackTiles(); }
  void SetOptions(const SessionOptions& options) { setup_.session = options; }
  const std::string& folder() const { return setup_.folder; }

  // Maps the scans of `scans` from next_scan() on. Once `stop` is true, those that have been read
  // are still mapped.
  void Process(StreamedScans* scans, const std::atomic<bool>* stop);
  // A file that will never be a scan.
  void SetAside(const std::string& file, const std::string& reason);
  // To be called between scans when none are coming: goes on with what is done piece by piece.
  // False if there is nothing left to do.
  bool Idle();
  void RequestCheckpoint() { checkpoints_->Request(); }
  // On the housekeeping thread, after what it has to do.
  void DoLater(std::function<void()> work) { checkpoints_->DoLater(std::move(work)); }
  // Until all that was begun so far is on disk, the trajectory files included.
  void WaitForHousekeeping();

  // A last checkpoint; then the last solve, after which nothing more can be mapped. All files but
  // those of the trajectory are left as they are: the session can be continued.
  //
  // Before all scans that were recorded have been mapped again, only the checkpoint: the files hold
  // more than is known by now.
  void Finish();
  // Scans that were recorded after the checkpoint that was loaded are being mapped again.
  bool Repeating() const;
  // All poses so far, in order; after Finish() the last ones.
  void ForEachPose(const FinalPoses::Visit& visit) const;
  // Those that are final by Finish() alone: not in the database, which may be continued.
  const std::vector<FinalPose>& tail() const { return tail_; }

 private:
  MappingCallbacks Callbacks();
  void OnScan(const MappedScan& report);
  void OnScanDone();
  bool FileIsGone(const MappedScan& report) const;
  bool HasChanged(const MappedScan& report) const;
  // What was recorded of the scan that is mapped again; null if none is.
  const ScanRecord* Recorded() const;
  void ReportDamage();

  SessionSetup setup_;
  SessionHooks hooks_;
  // Each goes before those that it works on, which are above it.
  SessionFolder folder_;
  std::unique_ptr<SessionDatabase> database_;
  std::unique_ptr<TileStore> tiles_;
  std::unique_ptr<ByteFile> submaps_;  // null without loops
  std::unique_ptr<Mapping> mapping_;
  std::unique_ptr<SessionLog> log_;
  std::unique_ptr<CheckpointWriting> checkpoints_;
  std::unique_ptr<TrajectoryPublisher> trajectory_;

  std::int64_t next_ = 0;
  std::int64_t repeat_from_ = 0;
  std::vector<ScanRecord> to_repeat_;
  const StreamedScans* scans_ = nullptr;  // those being mapped
  std::size_t damaged_ = 0;               // records of tiles and leaves that were told of
  bool finished_ = false;
  std::vector<FinalPose> tail_;  // poses that are final by Finish() alone
};

}  // namespace lamina
