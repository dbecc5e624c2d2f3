#include "io/store/tile_store.h"

#include <SQLiteCpp/SQLiteCpp.h>
#include <fmt/format.h>
#include <atomic>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <optional>
#include <unordered_map>
#include <utility>

#include "core/base/error.h"
#include "io/file/checksum.h"
#include "io/file/sqlite_file.h"
#include "io/store/tile_file.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

// SyncToDisk() brings the journal into the file, on a thread that has time. Where that cannot keep
// up with a writer that never pauses, Commit() has to.
constexpr std::size_t kMostTileLogBytes = 32 << 20;

// Its being there says that the file was found damaged while in use: SQLite looks at a page when it
// needs it, not at the start.
std::string FoundDamaged(const std::string& path) { return path + ".found_damaged"; }

std::int64_t Signed(VoxelKey key) { return static_cast<std::int64_t>(key); }

}  // namespace

struct TileStore::Impl {
  Impl(const std::string& path, Lifetime lifetime)
      : file(path, lifetime == Lifetime::kScratch ? TileFile::Purpose::kScratch
                                                  : TileFile::Purpose::kKept),
        keeps_taken(lifetime == Lifetime::kKept),
        database(file.database()) {
    put.emplace(database, "INSERT INTO voxels VALUES(?, ?, ?, NULL, ?, ?)");
    show.emplace(
        database,
        "SELECT crc, record FROM voxels WHERE tile = ? AND taken_at IS NULL ORDER BY root");
    show_root.emplace(database,
                      "SELECT crc, record FROM voxels WHERE tile = ? AND root = ? AND taken_at IS "
                      "NULL");
    // A scratch file is never gone back to: what is taken goes at once.
    const std::string leave =
        keeps_taken ? "UPDATE voxels SET taken_at = ?3" : "DELETE FROM voxels";
    const std::string of_tile = " WHERE tile = ?1 AND taken_at IS NULL";
    const std::string bytes = " RETURNING length(record)";
    take.emplace(database, leave + of_tile + bytes);
    take_root.emplace(database, leave + of_tile + " AND root = ?2" + bytes);
    forget.emplace(database,
                   "DELETE FROM voxels WHERE rowid IN (SELECT rowid FROM voxels WHERE taken_at <= "
                   "?1 ORDER BY taken_at LIMIT ?2)" +
                       bytes);
    if (keeps_taken) log_limit.emplace(&database, kMostTileLogBytes);
    CountTiles();
  }

  void CountTiles() {
    tiles.clear();
    records = 0;
    SQLite::Statement count(
        database, "SELECT tile, COUNT(*) FROM voxels WHERE taken_at IS NULL GROUP BY tile");
    while (count.executeStep()) {
      const auto number = static_cast<std::size_t>(count.getColumn(1).getInt64());
      tiles[static_cast<VoxelKey>(count.getColumn(0).getInt64())] = number;
      records += number;
    }
  }

  // Runs a statement that returns the bytes of each record that it finds. Returns their number.
  std::size_t Run(SQLite::Statement* statement, bool removes) {
    std::size_t rows = 0;
    for (; statement->executeStep(); ++rows) {
      if (removes) file.CountRemoved(static_cast<std::size_t>(statement->getColumn(0).getInt64()));
    }
    statement->reset();
    if (removes && !keeps_taken) TidyScratch(rows);
    return rows;
  }

  void TidyScratch(std::size_t removed) {
    constexpr std::size_t kRows = 400;
    taken_at_tidy += removed;
    if (taken_at_tidy < kRows) return;
    file.Tidy(2 * std::exchange(taken_at_tidy, 0));
    CommitTransaction();
  }

  // Records of columns crc, record.
  void ShowRows(SQLite::Statement* rows, const Visit& visit) {
    while (rows->executeStep()) {
      const SQLite::Column record = rows->getColumn(1);
      const std::string_view bytes(static_cast<const char*>(record.getBlob()),
                                   static_cast<std::size_t>(record.getBytes()));
      if (Crc32(bytes) == static_cast<std::uint32_t>(rows->getColumn(0).getInt64())) {
        visit(bytes);
      } else {
        ++damaged;
      }
    }
    rows->reset();
  }

  // Many changes make one transaction: it ends with Commit().
  void Begin() {
    if (!transaction) transaction.emplace(database);
  }

  void CommitTransaction() {
    file.WriteTotals();
    transaction->commit();
    transaction.reset();
  }

  TileFile file;
  const bool keeps_taken;
  SQLite::Database& database;
  std::optional<SQLite::Statement> put, show, take, show_root, take_root, forget;
  std::optional<SQLite::Transaction> transaction;
  std::optional<LogLimit> log_limit;
  std::unordered_map<VoxelKey, std::size_t> tiles;  // those that have records, and how many
  std::size_t records = 0;
  std::atomic<std::size_t> damaged{0};
  std::size_t taken_at_tidy = 0;    // records of a scratch file, since TileFile::Tidy()
  std::size_t taken = 0;            // records, since the beginning
  std::size_t taken_at_forget = 0;  // ... and until the last Forget()
};

TileStore::TileStore(std::string path, Lifetime lifetime)
    : path_(std::move(path)), lifetime_(lifetime) {
  std::error_code ignored;
  if (lifetime_ == Lifetime::kScratch) {
    fs::remove(path_, ignored);
    return;
  }
  if (fs::remove(FoundDamaged(path_), ignored)) {
    throw InputError(fmt::format("{}: is damaged: this was found when it was last used", path_));
  }
  Open();
}

TileStore::~TileStore() {
  impl_.reset();
  std::error_code ignored;
  if (lifetime_ == Lifetime::kScratch) fs::remove(path_, ignored);
}

template <typename Work>
auto TileStore::Guarded(const char* doing, const Work& work) const {
  return OnSqlite(path_, doing, [&] {
    try {
      return work();
    } catch (const SQLite::Exception& error) {
      if (lifetime_ == Lifetime::kKept && IsDamage(error)) std::ofstream(FoundDamaged(path_));
      throw;
    }
  });
}

TileStore::Impl& TileStore::Open() const {
  if (impl_) return *impl_;
  OpenSqlite(path_, [&] { impl_ = std::make_unique<Impl>(path_, lifetime_); });
  return *impl_;
}

bool TileStore::Has(VoxelKey tile) const { return impl_ && impl_->tiles.count(tile) > 0; }
bool TileStore::Empty() const { return !impl_ || impl_->tiles.empty(); }
void TileStore::ForEachTile(const std::function<void(VoxelKey tile)>& visit) const {
  if (!impl_) return;
  for (const auto& [tile, records] : impl_->tiles) visit(tile);
}
std::size_t TileStore::records() const { return impl_ ? impl_->records : 0; }
std::size_t TileStore::taken() const { return impl_ ? impl_->taken : 0; }
std::size_t TileStore::damaged() const { return impl_ ? impl_->damaged.load() : std::size_t{0}; }

void TileStore::Put(VoxelKey tile, VoxelKey root, std::string_view record) {
  Impl& impl = Open();
  Guarded("cannot be written", [&] {
    impl.Begin();
    impl.put->bind(1, Signed(tile));
    impl.put->bind(2, Signed(root));
    impl.put->bind(3, scan_);
    impl.put->bind(4, static_cast<std::int64_t>(Crc32(record)));
    impl.put->bindNoCopy(5, record.data(), static_cast<int>(record.size()));
    impl.put->exec();
    impl.put->reset();
    impl.file.CountAdded(record.size());
  });
  ++impl.tiles[tile];
  ++impl.records;
}

void TileStore::Take(VoxelKey tile, const Visit& visit) {
  if (!Has(tile)) return;
  Show(tile, visit);
  Impl& impl = *impl_;
  Guarded("cannot be written", [&] {
    impl.Begin();
    impl.take->bind(1, Signed(tile));
    if (impl.keeps_taken) impl.take->bind(3, scan_);
    impl.Run(&*impl.take, !impl.keeps_taken);
  });
  impl.records -= impl.tiles.at(tile);
  impl.taken += impl.tiles.at(tile);
  impl.tiles.erase(tile);
}

void TileStore::TakeRoot(VoxelKey tile, VoxelKey root, const Visit& visit) {
  if (!Has(tile)) return;
  Impl& impl = *impl_;
  const std::size_t taken = Guarded("cannot be written", [&] {
    impl.show_root->bind(1, Signed(tile));
    impl.show_root->bind(2, Signed(root));
    impl.ShowRows(&*impl.show_root, visit);
    impl.Begin();
    impl.take_root->bind(1, Signed(tile));
    impl.take_root->bind(2, Signed(root));
    if (impl.keeps_taken) impl.take_root->bind(3, scan_);
    return impl.Run(&*impl.take_root, !impl.keeps_taken);
  });
  if (taken == 0) return;
  --impl.records;
  ++impl.taken;
  if (--impl.tiles.at(tile) == 0) impl.tiles.erase(tile);
}

void TileStore::Show(VoxelKey tile, const Visit& visit) const {
  if (!Has(tile)) return;
  const std::lock_guard<std::mutex> lock(reading_);
  Guarded("cannot be read", [&] {
    impl_->show->bind(1, Signed(tile));
    impl_->ShowRows(&*impl_->show, visit);
  });
}

void TileStore::ShowAll(const Visit& visit) const {
  if (!impl_) return;
  const std::lock_guard<std::mutex> lock(reading_);
  Guarded("cannot be read", [&] {
    SQLite::Statement rows(
        impl_->database,
        "SELECT crc, record FROM voxels WHERE taken_at IS NULL ORDER BY tile, root");
    impl_->ShowRows(&rows, visit);
  });
}

void TileStore::CopyFrom(const std::string& path, std::int64_t scan) {
  Impl& impl = Open();
  OnSqlite(path_, "cannot be copied to", [&] {
    impl.transaction.reset();
    SQLite::Statement attach(impl.database, "ATTACH ? AS other");
    attach.bind(1, UntouchedUri(path));
    attach.exec();
    {
      SQLite::Transaction transaction(impl.database);
      impl.database.exec("DELETE FROM voxels");
      SQLite::Statement copy(impl.database,
                             "INSERT INTO voxels SELECT tile, root, -1, NULL, crc, record FROM "
                             "other.voxels WHERE stored_at <= ?1 AND (taken_at IS NULL OR "
                             "taken_at > ?1)");
      copy.bind(1, scan);
      copy.exec();
      impl.file.Recount();
      impl.file.WriteTotals();
      transaction.commit();
    }
    impl.database.exec("DETACH other");
    impl.CountTiles();
  });
}

void TileStore::RollBackTo(std::int64_t scan) {
  Impl& impl = Open();
  Commit();
  Guarded("cannot be written", [&] {
    impl.Begin();
    for (const char* statement :
         {"DELETE FROM voxels INDEXED BY here WHERE taken_at IS NULL AND stored_at > ? RETURNING "
          "length(record)",
          "DELETE FROM voxels INDEXED BY taken WHERE taken_at IS NOT NULL AND stored_at > ? "
          "RETURNING length(record)"}) {
      SQLite::Statement drop(impl.database, statement);
      drop.bind(1, scan);
      impl.Run(&drop, true);
    }
    SQLite::Statement untake(impl.database, "UPDATE voxels SET taken_at = NULL WHERE taken_at > ?");
    untake.bind(1, scan);
    untake.exec();
    impl.CommitTransaction();
    impl.CountTiles();
  });
}

void TileStore::Forget(std::int64_t scan) {
  if (!impl_) return;
  constexpr std::size_t kLeast = 400;
  const std::size_t before = std::exchange(impl_->taken_at_forget, impl_->taken);
  const std::size_t most = std::max(kLeast, 2 * (impl_->taken - before));
  Guarded("cannot be written", [&] {
    impl_->Begin();
    impl_->forget->bind(1, scan);
    impl_->forget->bind(2, static_cast<std::int64_t>(most));
    impl_->Run(&*impl_->forget, true);
    impl_->file.Tidy(most);
  });
}

void TileStore::Commit() {
  if (!impl_ || !impl_->transaction) return;
  Guarded("cannot be written", [&] {
    impl_->CommitTransaction();
    if (impl_->log_limit) impl_->log_limit->Keep();
  });
}

void TileStore::SyncToDisk() const {
  if (lifetime_ == Lifetime::kScratch) return;
  Guarded("cannot be written", [&] {
    SQLite::Database database(path_, SQLite::OPEN_READWRITE);
    database.setBusyTimeout(10000);
    BringLogIntoFile(&database);
  });
}

}  // namespace lamina
