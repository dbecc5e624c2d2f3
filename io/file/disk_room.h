// Room on the disk that holds a file, and the error that tells that there is none.
#pragma once

#include <cstdint>
#include <string>

#include "core/base/error.h"

namespace lamina {

// Something could not be written because its file system, or the quota on it, is full. The caller
// that waits until there is room (FreeBytes) can do the same again.
struct DiskFullError : OutputError {
  using OutputError::OutputError;
};

// Bytes that this process can still write to the file system on which `path`, which must exist,
// lies. Throws OutputError, naming the path. Thread-safe.
std::uint64_t FreeBytes(const std::string& path);

// Throws DiskFullError, with both numbers, if fewer than `needed` bytes are free where `path` is or
// is to be. Thread-safe.
void RequireRoom(const std::string& path, std::uint64_t needed);

// Throws "PATH: DOING: reason" for a value of errno: DiskFullError for a full disk, else
// OutputError.
[[noreturn]] void ThrowNotWritten(const std::string& path, const char* doing, int error);

}  // namespace lamina
