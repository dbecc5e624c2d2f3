// Bytes that need not stay in memory (core/base/byte_store.h), one after the other in a file.
//
// Damage is found by the CRC-32 of what was appended.
#pragma once

#include <atomic>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "core/base/byte_store.h"

namespace lamina {

// Throws OutputError, naming the file; of a full disk it is a DiskFullError (io/file/disk_room.h).
class ByteFile final : public ByteStore {
 public:
  enum class Lifetime {
    kScratch,   // without a name, gone with the process; made when the first bytes come
    kKept,      // as it was left
    kReadOnly,  // of another process, or of an earlier one: takes nothing, and stays as it is
  };
  ByteFile(std::string path, Lifetime lifetime);
  ~ByteFile() override;

  std::optional<StoredBytes> Append(std::string_view bytes) override;
  bool Read(const StoredBytes& place, char* to) const override;
  std::uint64_t size() const override { return size_; }
  void RollBackTo(std::uint64_t size) override;
  // The disk has the room again at once, where the file system can have files with holes: sizes and
  // places stay.
  void KeepOnly(const std::vector<StoredBytes>& places) override;

  // Reads so far that found damage. By any thread.
  std::size_t damaged() const { return damaged_; }

  // Makes durable what was appended before. By any thread, beside Append.
  void SyncToDisk() const;

 private:
  void Make();

  const std::string path_;
  const Lifetime lifetime_;
  int file_ = -1;
  std::uint64_t size_ = 0;
  mutable std::atomic<std::size_t> damaged_{0};
};

}  // namespace lamina
