// CRC-32 (ISO 3309, as zip and PNG have it) of bytes on disk: tells damage, not intent.
#pragma once

#include <cstdint>
#include <string_view>

namespace lamina {

// `before`: the checksum of the bytes before these, to go on from. Pure function; thread-safe.
std::uint32_t Crc32(std::string_view bytes, std::uint32_t before = 0);

}  // namespace lamina
