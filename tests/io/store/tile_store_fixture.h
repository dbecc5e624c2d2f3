// Records in a store of tiles, and the same work on two stores.
#pragma once

#include <SQLiteCpp/SQLiteCpp.h>
#include <gtest/gtest.h>

#include <cstring>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "io/store/tile_store.h"
#include "tests/support/files/io_test_files.h"
#include "tests/support/memory_voxel_store.h"
#include "tests/support/scenes/random_scenes.h"

namespace lamina {

using Records = std::vector<std::string>;
using Lifetime = TileStore::Lifetime;

// Keys far apart and near, with the highest and the lowest that there are.
inline constexpr VoxelKey kLargest = (VoxelKey{1} << (3 * kVoxelKeyBits)) - 1;
inline constexpr VoxelKey kTiles[] = {0, 1, 2, VoxelKey{1} << 40, kLargest - 1, kLargest};
inline constexpr int kRoots = 6;
inline VoxelKey RootOf(int i) {
  return i % 2 == 0 ? static_cast<VoxelKey>(i) : kLargest - static_cast<VoxelKey>(i);
}

inline Records Collect(const std::function<void(const VoxelStore::Visit&)>& from) {
  Records records;
  from([&](std::string_view record) { records.emplace_back(record); });
  return records;
}
inline Records All(const VoxelStore& store) {
  return Collect([&](const auto& visit) { store.ShowAll(visit); });
}

inline void ExpectSame(const VoxelStore& store, const VoxelStore& reference) {
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
inline std::string Record(VoxelKey tile, VoxelKey root, int number) {
  return Pack(tile, root, number) + std::string(static_cast<std::size_t>(number % 50), '\0');
}

// A store in memory with these records.
inline std::unique_ptr<MemoryVoxelStore> StoreOf(const Records& records) {
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

}  // namespace lamina
