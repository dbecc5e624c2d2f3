// The file of a TileStore (io/store/tile_store.h): its form, and how it stays as small as what it
// holds.
//
//     voxels(tile, root, stored_at, taken_at, crc, record)   taken_at NULL: in the store
//     here(tile, root, stored_at)    index of the rows that are in the store
//     taken(taken_at, stored_at)     index of those that have left it
//     totals(rows, bytes)            one row: number of rows of `voxels`, and bytes of their
//     records
//
// A B-tree in the order of the keys fills its pages by half to two thirds, and a record that is
// longer than a quarter of a page takes a page more. So rows lie in the order in which they came:
// each page is full before the next begins. Rows that go leave holes; where these are more than a
// ninth, the rows that came first are written once more at the end, and pages that are free go back
// to the system, both in portions (Tidy).
//
// Private to io/store.
#pragma once

#include <SQLiteCpp/SQLiteCpp.h>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

namespace lamina {

// Not thread-safe. Members throw SQLite::Exception.
class TileFile {
 public:
  enum class Purpose { kScratch, kKept };
  // Makes the file if it is not there. One of an older form is written anew in this one, and
  // replaced when that is whole and on disk. Throws OutputError if another program keeps it from
  // being replaced.
  TileFile(const std::string& path, Purpose purpose);

  SQLite::Database& database() { return database_; }
  std::size_t rows() const { return rows_; }

  // To be told of each change of `voxels`.
  void CountAdded(std::size_t bytes) { ++rows_, bytes_ += bytes; }
  void CountRemoved(std::size_t bytes) { --rows_, bytes_ -= bytes; }
  // Counts rows and bytes anew, after changes that were not counted.
  void Recount();
  // To be called before a transaction ends: the totals are part of it.
  void WriteTotals();

  // Within a transaction: moves some rows and frees some pages, if the file is too large for what
  // it holds. At most `most` pages and twice as many rows, so that no call takes long. Called as
  // often as rows go, and with as many, it keeps the file below 4/3 of its records, some ten bytes
  // a row, and a constant.
  void Tidy(std::size_t most);

 private:
  void MoveFirstRows(std::size_t most);

  SQLite::Database database_;
  std::size_t rows_ = 0, bytes_ = 0;
  std::size_t page_bytes_ = 0;
  std::optional<SQLite::Statement> last_to_move_, copy_, remove_, pages_, free_pages_, totals_;
};

}  // namespace lamina
