// Results of `lamina refine` that are done, in a file, so that it goes on where it was interrupted.
//
//     8 bytes "LAMINARJ"   u32 checksum of what all was made of
//     records:  u32 CRC-32 of the bytes   u64 how many   bytes: key and result, each with its size
//
// Little-endian. What stands behind the first record that is not whole is forgotten.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>

#include "backend/submaps/result_journal.h"
#include "io/store/byte_file.h"

namespace lamina {

class JournalFile final : public ResultJournal {
 public:
  // Goes on with the file that is there if it was made of the same. Throws OutputError.
  JournalFile(std::string path, std::uint32_t made_of);

  std::optional<std::string> Find(const std::string& key) const override;
  void Add(const std::string& key, const std::string& result) override;
  void Sync() override { file_.SyncToDisk(); }

  // That an earlier process has left.
  std::size_t found() const { return found_; }
  // All is done: the file goes.
  void Remove();

 private:
  void Read(const std::string& bytes);

  const std::string path_;
  std::map<std::string, std::string> results_;
  std::size_t found_ = 0;
  std::uint64_t whole_ = 0;  // bytes that are
  ByteFile file_;
};

}  // namespace lamina
