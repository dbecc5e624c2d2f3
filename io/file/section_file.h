// A file of sections, each with its checksum: whole, or not there.
//
//     8 bytes that tell the kind of file   u32 version
//     sections:            4 bytes tag   u32 CRC-32 of tag and bytes   u64 size   bytes
//     last section:        tag "END ", 8 bytes: u64 number of the sections before it
//
// Little-endian. Written under a temporary name, flushed to disk, renamed (io/file/file_writer.h).
// What the sections hold is for others to say.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "io/file/file_writer.h"

namespace lamina {

struct SectionFileKind {
  std::string_view magic;  // 8 characters
  std::uint32_t version = 0;
  const char* name = "";  // for messages: "a checkpoint"
};

// Not thread-safe. Throws OutputError. Without Commit() nothing is left on disk.
class SectionWriter {
 public:
  SectionWriter(const std::string& path, const SectionFileKind& kind);
  // `tag` has 4 characters.
  void Write(std::string_view tag, std::string_view bytes);
  void Commit();
  std::uint64_t bytes() const { return bytes_; }

 private:
  FileWriter writer_;
  std::uint64_t sections_ = 0, bytes_ = 0;
};

// Not thread-safe. Throws InputError, naming the file, if it cannot be read, is of another kind, is
// damaged, or ends too early; OtherFormatError if it is of another version.
class SectionReader {
 public:
  SectionReader(const std::string& path, const SectionFileKind& kind);
  ~SectionReader();
  // The next section; false after the last one, which makes sure that the file is whole.
  bool Next(std::string* tag, std::string* bytes);
  // Where in the file the bytes of the last section begin.
  std::uint64_t at() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace lamina
