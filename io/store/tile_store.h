// Root voxels on disk (core/map/voxel_store.h), in a file of SQLite's: what the map's budget does
// not hold in memory.
//
// Time is counted in scans. A record that is taken out stays in the file, with the scan at which
// it left, until Forget(); so the store can go back to what it was after an earlier scan, which a
// mapping that resumes from a checkpoint needs. (A scratch file has no past: what is taken out goes
// at once.) The form of the file, and how it stays small: io/store/tile_file.h.
//
// A damaged record is left out and counted, by its CRC-32; where the file itself is damaged,
// the call that meets that fails, and the next that opens it is told.
#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <string>

#include "core/map/voxel_store.h"

namespace lamina {

// Members that are const may be called by any number of threads at once. All throw OutputError,
// naming the file, if it cannot be read or written.
class TileStore final : public VoxelStore {
 public:
  enum class Lifetime {
    kScratch,  // emptied at the start, deleted at the end; made when the first record comes
    kKept,
  };
  // Throws InputError if a kept one is damaged, or was found to be when it was last in use.
  TileStore(std::string path, Lifetime lifetime);
  ~TileStore() override;

  // What happens from now on happens at this scan.
  void SetScan(std::int64_t scan) { scan_ = scan; }

  bool Has(VoxelKey tile) const override;
  bool Empty() const override;
  void ForEachTile(const std::function<void(VoxelKey tile)>& visit) const override;
  void Put(VoxelKey tile, VoxelKey root, std::string_view record) override;
  void Take(VoxelKey tile, const Visit& visit) override;
  void TakeRoot(VoxelKey tile, VoxelKey root, const Visit& visit) override;
  void Show(VoxelKey tile, const Visit& visit) const override;
  void ShowAll(const Visit& visit) const override;
  std::size_t records() const override;
  // Records that have been taken out since the store was opened.
  std::size_t taken() const;

  // In the place of all that is here, what another kept store had after a scan of its own; here it
  // has been from the beginning.
  void CopyFrom(const std::string& path, std::int64_t scan);

  // Back to how it was after that scan (-1: empty).
  void RollBackTo(std::int64_t scan);
  // Records that left at this scan or before go for good. So that no call takes long, at most some
  // hundred do, or twice as many as have left since the last call: called often, it keeps up.
  void Forget(std::int64_t scan);

  // Writes out what has been put and taken, so that SyncToDisk() by any thread makes it durable.
  void Commit();
  // Thread-safe. Also moves what has been committed from the journal into the file.
  void SyncToDisk() const;

  // Damaged records met so far.
  std::size_t damaged() const;

 private:
  struct Impl;
  Impl& Open() const;
  template <typename Work>
  auto Guarded(const char* doing, const Work& work) const;

  std::string path_;
  Lifetime lifetime_;
  std::int64_t scan_ = 0;
  mutable std::unique_ptr<Impl> impl_;
  mutable std::mutex reading_;  // statements are shared
};

}  // namespace lamina
