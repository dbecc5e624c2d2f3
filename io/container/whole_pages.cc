#include "io/container/whole_pages.h"

#include <sqlite3.h>

#include <algorithm>
#include <cstring>

#include "core/base/error.h"
#include "io/stream/byte_stream.h"

namespace lamina {
namespace {

// The header of a database, from its file format: size of a page, number of pages, and two counters
// that are equal if that number is kept.
constexpr std::size_t kHeadBytes = 100, kPageSizeAt = 16, kPagesAt = 28;
constexpr std::size_t kChangesAt = 24, kChangesOfPagesAt = 92;

std::uint64_t BigAt(const unsigned char* bytes, std::size_t at, std::size_t count) {
  std::uint64_t value = 0;
  for (std::size_t i = 0; i < count; ++i) value = value << 8U | bytes[at + i];
  return value;
}

std::uint64_t PageBytes(const unsigned char* head) {
  const std::uint64_t bytes = BigAt(head, kPageSizeAt, 2);
  return bytes == 1 ? 65536 : bytes;
}

// A file of the system's, cut at a whole page.
struct CutFile {
  sqlite3_file base;
  sqlite3_int64 bytes;
  unsigned char pages[4];
  // The system's own stands behind it.
  sqlite3_file* real() { return reinterpret_cast<sqlite3_file*>(this + 1); }
};

CutFile* Cut(sqlite3_file* file) { return reinterpret_cast<CutFile*>(file); }
sqlite3_file* Real(sqlite3_file* file) { return Cut(file)->real(); }

int Read(sqlite3_file* file, void* to, int bytes, sqlite3_int64 offset) {
  const int result = Real(file)->pMethods->xRead(Real(file), to, bytes, offset);
  // The number of pages, as far as it was read.
  for (std::size_t i = 0; i < sizeof(CutFile::pages); ++i) {
    const sqlite3_int64 at = static_cast<sqlite3_int64>(kPagesAt + i) - offset;
    if (at >= 0 && at < bytes) static_cast<unsigned char*>(to)[at] = Cut(file)->pages[i];
  }
  return result;
}

int FileSize(sqlite3_file* file, sqlite3_int64* bytes) {
  *bytes = Cut(file)->bytes;
  return SQLITE_OK;
}

int Close(sqlite3_file* file) { return Real(file)->pMethods->xClose(Real(file)); }
int Write(sqlite3_file*, const void*, int, sqlite3_int64) { return SQLITE_READONLY; }
int Truncate(sqlite3_file*, sqlite3_int64) { return SQLITE_READONLY; }
int Sync(sqlite3_file*, int) { return SQLITE_OK; }
int Lock(sqlite3_file*, int) { return SQLITE_OK; }
int IsReserved(sqlite3_file*, int* reserved) {
  *reserved = 0;
  return SQLITE_OK;
}
int Control(sqlite3_file*, int, void*) { return SQLITE_NOTFOUND; }
int SectorSize(sqlite3_file*) { return 0; }
int Characteristics(sqlite3_file*) { return SQLITE_IOCAP_IMMUTABLE; }

constexpr sqlite3_io_methods kMethods = [] {
  sqlite3_io_methods methods = {};
  methods.iVersion = 1;
  methods.xClose = Close;
  methods.xRead = Read;
  methods.xWrite = Write;
  methods.xTruncate = Truncate;
  methods.xSync = Sync;
  methods.xFileSize = FileSize;
  methods.xLock = Lock;
  methods.xUnlock = Lock;
  methods.xCheckReservedLock = IsReserved;
  methods.xFileControl = Control;
  methods.xSectorSize = SectorSize;
  methods.xDeviceCharacteristics = Characteristics;
  return methods;
}();

int Open(sqlite3_vfs* vfs, const char* name, sqlite3_file* file, int flags, int* out_flags) {
  auto* const system = static_cast<sqlite3_vfs*>(vfs->pAppData);
  file->pMethods = nullptr;
  const int opened = system->xOpen(system, name, Real(file), flags, out_flags);
  if (opened != SQLITE_OK) return opened;
  unsigned char head[kHeadBytes] = {};
  sqlite3_int64 bytes = 0;
  sqlite3_file* const real = Real(file);
  const bool read = real->pMethods->xRead(real, head, kHeadBytes, 0) == SQLITE_OK &&
                    real->pMethods->xFileSize(real, &bytes) == SQLITE_OK;
  const auto page = static_cast<sqlite3_int64>(PageBytes(head));
  if (!read || page == 0) {
    real->pMethods->xClose(real);
    return SQLITE_CANTOPEN;
  }
  Cut(file)->bytes = bytes / page * page;
  for (std::size_t i = 0; i < sizeof(CutFile::pages); ++i) {
    Cut(file)->pages[i] = static_cast<unsigned char>((bytes / page) >> (24 - 8 * i));
  }
  file->pMethods = &kMethods;
  return SQLITE_OK;
}

}  // namespace

std::uint64_t DeclaredSqliteBytes(const std::string& path) {
  const RandomFile file(path);
  unsigned char head[kHeadBytes] = {};
  file.ReadAt(0, reinterpret_cast<char*>(head), kHeadBytes);
  const bool kept = BigAt(head, kChangesAt, 4) == BigAt(head, kChangesOfPagesAt, 4);
  return kept ? PageBytes(head) * BigAt(head, kPagesAt, 4) : 0;
}

const char* WholePagesVfs() {
  static constexpr char kName[] = "lamina-whole-pages";
  static sqlite3_vfs vfs = [] {
    sqlite3_initialize();
    sqlite3_vfs* const system = sqlite3_vfs_find(nullptr);
    sqlite3_vfs copy = *system;
    copy.pNext = nullptr;
    copy.zName = kName;
    copy.szOsFile = static_cast<int>(sizeof(CutFile)) + system->szOsFile;
    copy.pAppData = system;
    copy.xOpen = Open;
    return copy;
  }();
  static const int registered = sqlite3_vfs_register(&vfs, 0);
  static_cast<void>(registered);
  return kName;
}

}  // namespace lamina
