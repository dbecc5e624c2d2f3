// IsWholeContainer: what the recorders of containers write last.
#include <algorithm>
#include <cstring>
#include <filesystem>
#include <string>

#include "core/base/error.h"
#include "io/container/message_container.h"
#include "io/container/whole_pages.h"
#include "io/file/folder_list.h"
#include "io/stream/byte_stream.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

std::string Piece(const RandomFile& file, std::uint64_t at, std::size_t bytes) {
  std::string piece(bytes, '\0');
  piece.resize(file.ReadAt(at, piece.data(), bytes));
  return piece;
}

// The place of the index in the first record is 0 until it is written.
bool IsWholeBag(const RandomFile& file) {
  constexpr std::size_t kHeadBytes = 512;
  constexpr std::string_view kField = "index_pos=";
  const std::string head = Piece(file, 0, kHeadBytes);
  const std::size_t at = head.find(kField);
  std::uint64_t index = 0;
  if (at == std::string::npos || at + kField.size() + sizeof(index) > head.size()) return false;
  std::memcpy(&index, head.data() + at + kField.size(), sizeof(index));
  return index != 0 && index < file.size();
}

bool IsWholeMcap(const RandomFile& file) {
  constexpr std::string_view kMcapEnd("\x89MCAP0\r\n", 8);
  if (file.size() < 2 * kMcapEnd.size()) return false;
  return Piece(file, file.size() - kMcapEnd.size(), kMcapEnd.size()) == kMcapEnd;
}

bool IsWholeDatabase(const std::string& path, const RandomFile& file) {
  for (const char* log : {"-wal", "-journal"}) {
    std::error_code error;
    if (fs::file_size(path + log, error) > 0 && !error) return false;
  }
  return file.size() >= DeclaredSqliteBytes(path);
}

}  // namespace

bool IsWholeContainer(const std::string& path) {
  const std::string ending = LowerEnding(path);
  try {
    const RandomFile file(path);
    if (file.size() == 0) return false;
    if (ending == ".bag") return IsWholeBag(file);
    if (ending == ".mcap") return IsWholeMcap(file);
    if (ending == ".db3") return IsWholeDatabase(path, file);
  } catch (const InputError&) {
    return false;
  }
  return true;
}

}  // namespace lamina
