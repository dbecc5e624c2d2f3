// Where bytes go that need not stay in memory: written once, read again whenever they are needed.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>
#include <vector>

namespace lamina {

// Where bytes are in a store, and their checksum.
struct StoredBytes {
  std::uint64_t at = 0, size = 0;
  std::uint32_t checksum = 0;
};

class ByteStore {
 public:
  virtual ~ByteStore() = default;
  ByteStore() = default;
  ByteStore(const ByteStore&) = delete;
  ByteStore& operator=(const ByteStore&) = delete;

  // One thread at a time. Nothing where the store takes no more: then the caller keeps them. Throws
  // OutputError when the medium fails.
  virtual std::optional<StoredBytes> Append(std::string_view bytes) = 0;
  // `to` has room for all of it. False, and nothing is told of `to`, if it is damaged. Thread-safe.
  virtual bool Read(const StoredBytes& place, char* to) const = 0;

  // Bytes that have been appended.
  virtual std::uint64_t size() const = 0;
  // Back to how it was when it had so many. Throws InputError if it has not.
  virtual void RollBackTo(std::uint64_t size) = 0;
  // What lies before and between these places will not be read again. By any thread, beside Append.
  virtual void KeepOnly(const std::vector<StoredBytes>& places) = 0;
};

}  // namespace lamina
