#include "io/store/tile_store.h"

#include <SQLiteCpp/SQLiteCpp.h>

#include <map>
#include <memory>
#include <set>

#include "io/file/checksum.h"
#include "tests/support/files/io_test_files.h"
#include "tests/support/memory_voxel_store.h"
#include "tests/support/scenes/random_scenes.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;
using Records = std::vector<std::string>;
using Lifetime = TileStore::Lifetime;

// Keys far apart and near, with the highest and the lowest that there are.
constexpr VoxelKey kLargest = (VoxelKey{1} << (3 * kVoxelKeyBits)) - 1;
const VoxelKey kTiles[] = {0, 1, 2, VoxelKey{1} << 40, kLargest - 1, kLargest};
constexpr int kRoots = 6;
VoxelKey RootOf(int i) {
  return i % 2 == 0 ? static_cast<VoxelKey>(i) : kLargest - static_cast<VoxelKey>(i);
}

Records Collect(const std::function<void(const VoxelStore::Visit&)>& from) {
  Records records;
  from([&](std::string_view record) { records.emplace_back(record); });
  return records;
}
Records All(const VoxelStore& store) {
  return Collect([&](const auto& visit) { store.ShowAll(visit); });
}

void ExpectSame(const VoxelStore& store, const VoxelStore& reference) {
  ASSERT_EQ(store.Empty(), reference.Empty());
  ASSERT_EQ(store.records(), reference.records());
  ASSERT_EQ(All(store), All(reference));
  for (const VoxelKey tile : kTiles) {
    ASSERT_EQ(store.Has(tile), reference.Has(tile));
    if (!reference.Has(tile)) continue;
    const auto show = [tile](const VoxelStore& s) {
      return Collect([&](const auto& visit) { s.Show(tile, visit); });
    };
    ASSERT_EQ(show(store), show(reference));
  }
}

// A record that tells where it belongs.
std::string Record(VoxelKey tile, VoxelKey root, int number) {
  return Pack(tile, root, number) + std::string(static_cast<std::size_t>(number % 50), '\0');
}

// A store in memory with these records.
std::unique_ptr<MemoryVoxelStore> StoreOf(const Records& records) {
  auto store = std::make_unique<MemoryVoxelStore>();
  for (const std::string& record : records) {
    VoxelKey tile = 0, root = 0;
    std::memcpy(&tile, record.data(), sizeof(tile));
    std::memcpy(&root, record.data() + sizeof(tile), sizeof(root));
    store->Put(tile, root, record);
  }
  return store;
}

// Work as a map does it, at random, on two stores that must give the same.
class Worker {
 public:
  explicit Worker(unsigned seed) : draws_(seed) {}

  void Step(VoxelStore* store, VoxelStore* reference) {
    const VoxelKey tile = kTiles[draws_.Integer(0, std::size(kTiles) - 1)];
    const VoxelKey root = RootOf(draws_.Integer(0, kRoots - 1));
    const auto take_root = [&](VoxelStore* s) {
      return Collect([&](const auto& visit) { s->TakeRoot(tile, root, visit); });
    };
    const auto take = [&](VoxelStore* s) {
      return Collect([&](const auto& visit) { s->Take(tile, visit); });
    };
    const int what = draws_.Integer(0, 9);
    if (what < 2) {
      if (!reference->Has(tile)) return;
      ASSERT_EQ(take(store), take(reference));
    } else {
      ASSERT_EQ(take_root(store), take_root(reference));
      if (what < 4) return;
      const std::string record = Record(tile, root, ++number_);
      store->Put(tile, root, record);
      reference->Put(tile, root, record);
    }
  }

 private:
  Draws draws_;
  int number_ = 0;
};

class TileStoreTest : public FilesTest {
 protected:
  std::string Tiles() const { return Path("tiles.db"); }
  void Execute(const std::string& statement) const {
    SQLite::Database(Tiles(), SQLite::OPEN_READWRITE).exec(statement);
  }
  int Rows() const {
    SQLite::Database database(Tiles(), SQLite::OPEN_READONLY);
    return database.execAndGet("SELECT COUNT(*) FROM voxels").getInt();
  }
};

TEST_F(TileStoreTest, KeepsTheContractAsAStoreInMemoryDoes) {
  for (const Lifetime lifetime : {Lifetime::kScratch, Lifetime::kKept}) {
    for (unsigned seed = 0; seed < 5; ++seed) {
      SCOPED_TRACE(seed);
      fs::remove(Tiles());
      TileStore store(Tiles(), lifetime);
      MemoryVoxelStore reference;
      ExpectSame(store, reference);
      Worker worker(seed);
      for (int i = 0; i < 400 && !HasFatalFailure(); ++i) {
        store.SetScan(i / 7);
        worker.Step(&store, &reference);
        if (i % 10 == 0) ExpectSame(store, reference);
        if (i % 50 == 0) store.Commit();
        if (i % 60 == 0) store.Forget(i / 7 - 5);
      }
      ExpectSame(store, reference);
    }
  }
}

TEST_F(TileStoreTest, AScratchFileIsMadeWhenItIsNeededAndGoneAtTheEnd) {
  Write("tiles.db", "left by somebody");
  {
    TileStore store(Tiles(), Lifetime::kScratch);
    EXPECT_FALSE(fs::exists(Tiles()));
    EXPECT_TRUE(store.Empty());
    store.Put(1, 2, "record");
    EXPECT_TRUE(fs::exists(Tiles()));
    store.Commit();
    store.SyncToDisk();
  }
  EXPECT_TRUE(fs::is_empty(folder_));
}

TEST_F(TileStoreTest, WhatIsCommittedIsThereAgainAndTheRestIsNot) {
  {
    TileStore store(Tiles(), Lifetime::kKept);
    store.Put(1, 2, "kept");
    store.Commit();
    store.SyncToDisk();
    store.Put(1, 3, "lost");
    store.Take(1, [](std::string_view) {});
  }
  TileStore store(Tiles(), Lifetime::kKept);
  EXPECT_EQ(All(store), Records{"kept"});
}

TEST_F(TileStoreTest, RollsBackToWhatItWasAfterAnyScan) {
  constexpr int kScans = 30;
  for (unsigned seed = 10; seed < 22; ++seed) {
    for (const bool reopened : {false, true}) {
      SCOPED_TRACE(seed);
      fs::remove(Tiles());
      auto store = std::make_unique<TileStore>(Tiles(), Lifetime::kKept);
      auto reference = std::make_unique<MemoryVoxelStore>();
      std::map<int, Records> after = {{-1, {}}};
      Worker worker(seed);
      Draws draws(seed);
      const auto work = [&](int from, int to) {
        for (int scan = from; scan < to; ++scan) {
          store->SetScan(scan);
          for (int i = draws.Integer(0, 8); i > 0; --i) worker.Step(store.get(), reference.get());
          after[scan] = All(*reference);
          if (draws.Integer(0, 2) == 0) store->Commit();
        }
      };
      work(0, kScans);
      // Back, and on from there, a few times; what cannot be reached any more may be forgotten.
      int oldest = -1;
      for (int round = 0; round < 3; ++round) {
        const int back = round == 2 ? oldest : draws.Integer(oldest, kScans - 1);
        oldest = draws.Integer(oldest, back);
        store->Forget(oldest);
        store->Commit();
        if (reopened) {
          store.reset();
          store = std::make_unique<TileStore>(Tiles(), Lifetime::kKept);
        }
        store->RollBackTo(back);
        reference = StoreOf(after[back]);
        ExpectSame(*store, *reference);
        work(back + 1, kScans);
        ExpectSame(*store, *reference);
      }
    }
  }
}

TEST_F(TileStoreTest, RollsBackWhatWasNotCommittedToo) {
  TileStore store(Tiles(), Lifetime::kKept);
  store.SetScan(1);
  store.Put(1, 1, "one");
  store.SetScan(2);
  store.Take(1, [](std::string_view) {});
  store.Put(2, 2, "two");
  store.RollBackTo(1);
  EXPECT_EQ(All(store), Records{"one"});
  store.RollBackTo(-1);
  EXPECT_TRUE(store.Empty());
}

TEST_F(TileStoreTest, ForgettingRemovesWhatLeftAndNoMoreThanSomeHundredAtATime) {
  constexpr int kRecords = 3000;
  TileStore store(Tiles(), Lifetime::kKept);
  for (int i = 0; i < kRecords; ++i)
    store.Put(static_cast<VoxelKey>(i / 10), static_cast<VoxelKey>(i), "x");
  store.SetScan(5);
  for (VoxelKey tile = 0; tile < kRecords / 20; ++tile) store.Take(tile, [](std::string_view) {});
  store.Commit();
  store.Forget(4);
  store.Commit();
  EXPECT_EQ(Rows(), kRecords);
  int calls = 0, rows = kRecords;
  while (rows > kRecords / 2) {
    store.Forget(5);
    store.Commit();
    const int left = Rows();
    ASSERT_LT(left, rows);
    EXPECT_GE(left, rows - 1000);
    rows = left;
    ++calls;
  }
  EXPECT_EQ(rows, kRecords / 2);
  EXPECT_GT(calls, 1);
  EXPECT_EQ(store.records(), static_cast<std::size_t>(kRecords / 2));
}

// Of all records that are there only some stay, which lie far apart: what is between them is free.
TEST_F(TileStoreTest, TheFileIsAsSmallAsWhatIsInItWhateverLeaves) {
  constexpr int kRecords = 6000, kPerCall = 200;
  constexpr std::size_t kConstant = 1 << 20;
  Draws draws(5);
  TileStore store(Tiles(), Lifetime::kKept);
  std::size_t bytes = 0, most = 0;
  for (int i = 0; i < kRecords; ++i) {
    const auto key = static_cast<VoxelKey>(i);
    const std::string record(static_cast<std::size_t>(draws.Integer(100, 4000)), 'r');
    store.Put(key, key, record);
    bytes += record.size();
  }
  store.Commit();
  store.SyncToDisk();
  most = fs::file_size(Tiles());
  EXPECT_LT(most, bytes + bytes / 3 + kConstant);
  for (int scan = 1; scan <= kRecords / kPerCall; ++scan) {
    store.SetScan(scan);
    for (int i = kPerCall * (scan - 1); i < kPerCall * scan; ++i) {
      const VoxelKey key = (static_cast<VoxelKey>(i) * 7919) % kRecords;
      if (key % 5 == 0) continue;
      store.Take(key, [&](std::string_view record) { bytes -= record.size(); });
    }
    store.Forget(scan);
    store.Commit();
    store.SyncToDisk();
    EXPECT_LT(fs::file_size(Tiles()), bytes + bytes / 3 + kConstant) << "after scan " << scan;
  }
  EXPECT_EQ(store.records(), static_cast<std::size_t>(kRecords / 5));
  EXPECT_EQ(Rows(), kRecords / 5);
  EXPECT_EQ(All(store).size(), store.records()) << "moved, not lost";
  EXPECT_LT(fs::file_size(Tiles()), most / 2);
}

TEST_F(TileStoreTest, AScratchFileDoesNotGrowWhereRecordsComeAndGo) {
  TileStore store(Tiles(), Lifetime::kScratch);
  const std::string record(1500, 'r');
  std::uintmax_t first = 0;
  for (int lap = 0; lap < 12; ++lap) {
    for (VoxelKey key = 0; key < 1000; ++key) store.Put(key / 4, key, record);
    for (VoxelKey tile = 0; tile < 250; ++tile) store.Take(tile, [](std::string_view) {});
    if (lap == 2) first = fs::file_size(Tiles());
  }
  EXPECT_LE(fs::file_size(Tiles()), first + (1 << 20));
}

TEST_F(TileStoreTest, AFileInTheOrderOfItsKeysIsWrittenAnew) {
  auto reference = std::make_unique<MemoryVoxelStore>();
  std::size_t bytes = 0;
  {
    SQLite::Database old(Tiles(), SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE);
    old.exec(
        "PRAGMA journal_mode=WAL; CREATE TABLE voxels(tile INTEGER NOT NULL, root INTEGER NOT "
        "NULL, stored_at INTEGER NOT NULL, taken_at INTEGER, crc INTEGER NOT NULL, record BLOB NOT "
        "NULL, PRIMARY KEY(tile, root, stored_at)) WITHOUT ROWID; CREATE INDEX taken ON "
        "voxels(taken_at) WHERE taken_at IS NOT NULL; BEGIN");
    for (int i = 0; i < 2000; ++i) {
      const auto key = static_cast<VoxelKey>(i);
      const std::string record = Pack(key, key, i) + std::string(1200, 'r');
      SQLite::Statement put(old, "INSERT INTO voxels VALUES(?1, ?1, ?2, ?3, ?4, ?5)");
      put.bind(1, i);
      put.bind(2, i % 10);
      if (i % 3 == 0) put.bind(3, 15);
      put.bind(4, static_cast<std::int64_t>(Crc32(record)));
      put.bind(5, record.data(), static_cast<int>(record.size()));
      put.exec();
      bytes += record.size();
      if (i % 10 < 5) reference->Put(key, key, record);
    }
    old.exec("COMMIT");
  }
  ASSERT_GT(fs::file_size(Tiles()), 2 * bytes);
  {
    TileStore store(Tiles(), Lifetime::kKept);
    store.SyncToDisk();
    EXPECT_LT(fs::file_size(Tiles()), bytes + bytes / 3 + (1 << 20));
    EXPECT_EQ(store.records(), 1333U);
    store.RollBackTo(4);
    ExpectSame(store, *reference);
  }
  ExpectSame(TileStore(Tiles(), Lifetime::kKept), *reference);
  EXPECT_FALSE(fs::exists(Tiles() + ".partial"));
}

TEST_F(TileStoreTest, DamagedRecordsAreLeftOutAndCounted) {
  const Records records = {Record(1, 1, 1), Record(1, 2, 2), Record(1, 3, 3), Record(2, 4, 4)};
  {
    TileStore store(Tiles(), Lifetime::kKept);
    for (const std::string& record : records) {
      VoxelKey key[2];
      std::memcpy(key, record.data(), sizeof(key));
      store.Put(key[0], key[1], record);
    }
    store.Commit();
  }
  Execute("UPDATE voxels SET record = CAST(X'00' || substr(record, 2) AS BLOB) WHERE root = 1");
  Execute("UPDATE voxels SET record = substr(record, 1, length(record) - 1) WHERE root = 3");
  Execute("UPDATE voxels SET crc = crc + 1 WHERE root = 4");
  TileStore store(Tiles(), Lifetime::kKept);
  EXPECT_EQ(store.records(), 4U);
  EXPECT_EQ(All(store), Records{records[1]});
  EXPECT_EQ(store.damaged(), 3U);
  EXPECT_TRUE(Collect([&](const auto& visit) { store.TakeRoot(1, 1, visit); }).empty());
  EXPECT_EQ(Collect([&](const auto& visit) { store.Take(1, visit); }), Records{records[1]});
  EXPECT_EQ(store.damaged(), 5U);
  EXPECT_TRUE(Collect([&](const auto& visit) { store.Take(2, visit); }).empty());
  EXPECT_TRUE(store.Empty()) << "damaged records go with their tile";
}

// SQLite meets some damage only when it needs the page. Whatever page it is: found at the start, or
// left out and counted, or an error after which the next start finds it.
TEST_F(TileStoreTest, AnyDamagedPageIsFoundAtTheLatestAtTheNextStart) {
  {
    TileStore store(Tiles(), Lifetime::kKept);
    for (VoxelKey i = 0; i < 12; ++i) store.Put(i, i, std::string(36000, 'r'));
    store.Commit();
    store.SyncToDisk();
  }
  const std::string sound = Bytes(Tiles());
  constexpr std::size_t kPage = 16384;
  ASSERT_GT(sound.size(), 20 * kPage);
  int at_start = 0, left_out = 0, in_use = 0;
  for (std::size_t page = 1; page < sound.size() / kPage; ++page) {
    std::string bytes = sound;
    bytes.replace(page * kPage, kPage, kPage, '\xff');
    Write("tiles.db", bytes);
    try {
      TileStore store(Tiles(), Lifetime::kKept);
      const std::size_t whole = All(store).size();
      EXPECT_EQ(whole + store.damaged(), 12U) << "page " << page;
      ++left_out;
      continue;
    } catch (const InputError&) {
      ++at_start;
      continue;
    } catch (const OutputError&) {
      ++in_use;
    }
    EXPECT_THAT(MessageOf<InputError>([&] { TileStore(Tiles(), Lifetime::kKept); }),
                testing::HasSubstr("tiles.db: is damaged"));
    // Who sets the file aside starts with a new one.
    fs::remove(Tiles());
    EXPECT_TRUE(TileStore(Tiles(), Lifetime::kKept).Empty());
  }
  EXPECT_GT(at_start, 0);
  EXPECT_GT(in_use, 0);
  RecordProperty("left_out", left_out);
}

TEST_F(TileStoreTest, CopiesWhatAnotherHadAfterAScan) {
  const std::string other = Path("other 100%?#.db");
  Records after_five;
  {
    TileStore source(other, Lifetime::kKept);
    MemoryVoxelStore reference;
    Worker worker(77);
    for (int scan = 0; scan < 12; ++scan) {
      source.SetScan(scan);
      for (int i = 0; i < 10; ++i) worker.Step(&source, &reference);
      if (scan == 5) after_five = All(reference);
    }
    source.Commit();
  }
  const std::string bytes = Bytes(other);
  {
    TileStore store(Tiles(), Lifetime::kKept);
    store.Put(9, 9, "to be replaced");
    store.CopyFrom(other, 5);
    ExpectSame(store, *StoreOf(after_five));
    // It has been here from the beginning.
    store.SetScan(0);
    store.Take(kTiles[0], [](std::string_view) {});
    store.RollBackTo(-1);
    ExpectSame(store, *StoreOf(after_five));
  }
  EXPECT_EQ(Bytes(other), bytes);
  std::set<std::string> names;
  for (const auto& entry : fs::directory_iterator(folder_)) {
    names.insert(entry.path().filename().string());
  }
  EXPECT_EQ(names, (std::set<std::string>{"other 100%?#.db", "tiles.db"})) << "traces of reading";
  ExpectSame(TileStore(Tiles(), Lifetime::kKept), *StoreOf(after_five));
}

TEST_F(TileStoreTest, CopyingFromNowhereIsAnError) {
  TileStore store(Tiles(), Lifetime::kKept);
  EXPECT_THROW(store.CopyFrom(Path("none.db"), 5), OutputError);
}

TEST_F(TileStoreTest, AFileOfAnotherKindIsAnErrorThatNamesIt) {
  Write("tiles.db", std::string(10000, 'x'));
  EXPECT_THAT(MessageOf<InputError>([&] { TileStore(Tiles(), Lifetime::kKept); }),
              testing::HasSubstr(Tiles()));
}

TEST_F(TileStoreTest, AFolderThatIsMissingIsNamed) {
  EXPECT_THAT(MessageOf<OutputError>([&] { TileStore(Path("none/tiles.db"), Lifetime::kKept); }),
              testing::HasSubstr("none/tiles.db"));
  TileStore scratch(Path("none/tiles.db"), Lifetime::kScratch);
  EXPECT_THROW(scratch.Put(1, 1, "x"), OutputError);
}

}  // namespace
}  // namespace lamina
