// All bytes of a place in an open file, which a call of the system may read or write in part.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string_view>

namespace lamina {

// Thread-safe, each file's own position stays. Whether all were written; errno tells why not.
bool WriteAt(int file, std::uint64_t at, std::string_view bytes);
// How many of `bytes` were read to `to`: all that the file has there. Nothing if it cannot be read;
// errno tells why.
std::optional<std::size_t> ReadAt(int file, std::uint64_t at, char* to, std::size_t bytes);

}  // namespace lamina
