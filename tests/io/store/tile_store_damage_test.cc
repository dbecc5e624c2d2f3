// Stores of tiles that are damaged, of another kind, or copied.

#include "io/file/checksum.h"
#include "tests/io/store/tile_store_fixture.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

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
