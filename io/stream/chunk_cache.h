// Unpacked chunks that were read last.
#pragma once

#include <condition_variable>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <mutex>
#include <string_view>

#include "io/stream/byte_stream.h"

namespace lamina {

// Thread-safe. Chunks in use, too, count as part of the budget: who wants one more waits.
class ChunkCache {
 public:
  explicit ChunkCache(std::size_t budget_bytes = std::size_t{24} << 20) : budget_(budget_bytes) {}

  // A number for the first half of a key; the other is a chunk's place in its file.
  std::uint32_t NextFile();
  // For what is read beside the chunks.
  SpareBuffers& spare() { return spare_; }

  // Hands `use` the chunk, unpacked by `unpack` if it is not there; what that throws goes on to the
  // caller. `bytes`, its unpacked size, is at most the budget. `use` must not come back here.
  struct Key {
    std::uint32_t file = 0;
    std::uint64_t chunk = 0;
    bool operator<(const Key& other) const {
      return file != other.file ? file < other.file : chunk < other.chunk;
    }
  };
  void With(const Key& key, std::size_t bytes, const std::function<ByteBuffer()>& unpack,
            const std::function<void(std::string_view)>& use);

 private:
  struct Entry {
    ByteBuffer data;
    std::size_t bytes = 0;
    std::size_t users = 0;
    std::uint64_t last_use = 0;
    bool ready = false;
  };
  using Entries = std::map<Key, Entry>;

  // The entry of the chunk with one more user, ready or to be filled by the caller.
  Entries::iterator Enter(std::unique_lock<std::mutex>* lock, const Key& key, std::size_t bytes);
  bool MakeRoom(std::size_t bytes);

  const std::size_t budget_;
  std::mutex mutex_;
  std::condition_variable changed_;
  Entries entries_;
  std::size_t used_ = 0;
  std::uint64_t uses_ = 0;
  std::uint32_t files_ = 0;
  SpareBuffers spare_;
};

}  // namespace lamina
