#include "io/tile_store.h"

#include <SQLiteCpp/Backup.h>
#include <SQLiteCpp/SQLiteCpp.h>
#include <fmt/format.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <optional>
#include <unordered_map>
#include <utility>

#include "core/error.h"
#include "io/checksum.h"
#include "io/sqlite_file.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

constexpr const char* kSchema =
    "CREATE TABLE IF NOT EXISTS voxels("
    " tile INTEGER NOT NULL, root INTEGER NOT NULL, stored_at INTEGER NOT NULL,"
    " taken_at INTEGER, crc INTEGER NOT NULL, record BLOB NOT NULL,"
    " PRIMARY KEY(tile, root, stored_at)) WITHOUT ROWID;"
    "CREATE INDEX IF NOT EXISTS taken ON voxels(taken_at) WHERE taken_at IS NOT NULL;";
// With the journal in memory a crash may leave a scratch file in pieces, which nobody will miss.
constexpr const char* kScratch =
    "PRAGMA journal_mode=MEMORY; PRAGMA synchronous=OFF; PRAGMA locking_mode=EXCLUSIVE;";
// The journal is brought into the file by SyncToDisk(), on a thread that has time.
constexpr const char* kKept =
    "PRAGMA journal_mode=WAL; PRAGMA synchronous=NORMAL; PRAGMA wal_autocheckpoint=0;"
    "PRAGMA journal_size_limit=33554432;";
// Where that thread cannot keep up with a writer that never pauses, Commit() has to.
constexpr std::size_t kMostLogBytes = 32 << 20;

// Its being there says that the file was found damaged while in use: SQLite looks at a page when it
// needs it, not at the start.
std::string FoundDamaged(const std::string& path) { return path + ".found_damaged"; }

std::int64_t Signed(VoxelKey key) { return static_cast<std::int64_t>(key); }

}  // namespace

struct TileStore::Impl {
  Impl(const std::string& path, Lifetime lifetime)
      : database(path, SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE) {
    database.setBusyTimeout(10000);
    database.exec(lifetime == Lifetime::kScratch ? kScratch : kKept);
    database.exec(kSchema);
    put.emplace(database, "INSERT OR REPLACE INTO voxels VALUES(?, ?, ?, NULL, ?, ?)");
    show.emplace(
        database,
        "SELECT crc, record FROM voxels WHERE tile = ? AND taken_at IS NULL ORDER BY root");
    take.emplace(database, "UPDATE voxels SET taken_at = ? WHERE tile = ? AND taken_at IS NULL");
    show_root.emplace(database,
                      "SELECT crc, record FROM voxels WHERE tile = ? AND root = ? AND taken_at IS "
                      "NULL");
    take_root.emplace(database,
                      "UPDATE voxels SET taken_at = ? WHERE tile = ? AND root = ? AND taken_at IS "
                      "NULL");
    forget.emplace(database,
                   "DELETE FROM voxels WHERE (tile, root, stored_at) IN (SELECT tile, root, "
                   "stored_at FROM voxels WHERE taken_at <= ? LIMIT ?)");
    if (lifetime == Lifetime::kKept) log_limit.emplace(&database, kMostLogBytes);
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

  SQLite::Database database;
  std::optional<SQLite::Statement> put, show, take, show_root, take_root, forget;
  std::optional<SQLite::Transaction> transaction;
  std::optional<LogLimit> log_limit;
  std::unordered_map<VoxelKey, std::size_t> tiles;  // those that have records, and how many
  std::size_t records = 0, damaged = 0;
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
std::size_t TileStore::damaged() const { return impl_ ? impl_->damaged : 0; }

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
    impl.take->bind(1, scan_);
    impl.take->bind(2, Signed(tile));
    impl.take->exec();
    impl.take->reset();
  });
  impl.records -= impl.tiles.at(tile);
  impl.taken += impl.tiles.at(tile);
  impl.tiles.erase(tile);
}

void TileStore::TakeRoot(VoxelKey tile, VoxelKey root, const Visit& visit) {
  if (!Has(tile)) return;
  Impl& impl = *impl_;
  const int taken = Guarded("cannot be written", [&] {
    impl.show_root->bind(1, Signed(tile));
    impl.show_root->bind(2, Signed(root));
    impl.ShowRows(&*impl.show_root, visit);
    impl.Begin();
    impl.take_root->bind(1, scan_);
    impl.take_root->bind(2, Signed(tile));
    impl.take_root->bind(3, Signed(root));
    const int rows = impl.take_root->exec();
    impl.take_root->reset();
    return rows;
  });
  if (taken == 0) return;
  --impl.records;
  ++impl.taken;
  if (--impl.tiles.at(tile) == 0) impl.tiles.erase(tile);
}

void TileStore::Show(VoxelKey tile, const Visit& visit) const {
  if (!Has(tile)) return;
  Guarded("cannot be read", [&] {
    impl_->show->bind(1, Signed(tile));
    impl_->ShowRows(&*impl_->show, visit);
  });
}

void TileStore::ShowAll(const Visit& visit) const {
  if (!impl_) return;
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
    {
      SQLite::Database other = OpenUntouched(path);
      SQLite::Backup backup(impl.database, other);
      backup.executeStep(-1);
    }
    impl.database.exec(kKept);
    SQLite::Transaction transaction(impl.database);
    SQLite::Statement drop(impl.database,
                           "DELETE FROM voxels WHERE stored_at > ?1 OR taken_at <= ?1");
    drop.bind(1, scan);
    drop.exec();
    impl.database.exec("UPDATE voxels SET stored_at = -1, taken_at = NULL");
    transaction.commit();
    impl.CountTiles();
  });
}

void TileStore::RollBackTo(std::int64_t scan) {
  Impl& impl = Open();
  Commit();
  Guarded("cannot be written", [&] {
    SQLite::Transaction transaction(impl.database);
    SQLite::Statement drop(impl.database, "DELETE FROM voxels WHERE stored_at > ?");
    drop.bind(1, scan);
    drop.exec();
    SQLite::Statement untake(impl.database, "UPDATE voxels SET taken_at = NULL WHERE taken_at > ?");
    untake.bind(1, scan);
    untake.exec();
    transaction.commit();
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
    impl_->forget->exec();
    impl_->forget->reset();
  });
}

void TileStore::Commit() {
  if (!impl_ || !impl_->transaction) return;
  Guarded("cannot be written", [&] {
    impl_->transaction->commit();
    impl_->transaction.reset();
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
