#include "io/store/tile_store.h"

#include <SQLiteCpp/SQLiteCpp.h>

#include <atomic>
#include <map>
#include <memory>
#include <thread>

#include "tests/io/store/tile_store_fixture.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

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

TEST_F(TileStoreTest, ManyThreadsReadItAtOnce) {
  TileStore store(Path("tiles.db"), TileStore::Lifetime::kScratch);
  constexpr VoxelKey kTiles = 8;
  for (VoxelKey tile = 0; tile < kTiles; ++tile)
    store.Put(tile, 1, std::string(100, char('a' + tile)));
  std::atomic<int> right = 0;
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t) {
    threads.emplace_back([&] {
      for (int i = 0; i < 200; ++i) {
        const VoxelKey tile = static_cast<VoxelKey>(i) % kTiles;
        store.Show(tile, [&](std::string_view record) {
          right += record == std::string(100, char('a' + tile)) ? 1 : 0;
        });
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(right, 800);
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

}  // namespace
}  // namespace lamina
