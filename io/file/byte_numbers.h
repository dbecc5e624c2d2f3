// Numbers out of the bytes of files and packets, and into them. Little-endian, as this machine is,
// unless said.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <string>
#include <string_view>

namespace lamina {

static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "numbers are read as they lie in files");

template <typename T>
T Swapped(T value) {
  char bytes[sizeof(T)];
  std::memcpy(bytes, &value, sizeof(T));
  std::reverse(bytes, bytes + sizeof(T));
  std::memcpy(&value, bytes, sizeof(T));
  return value;
}

// `swapped`: in the other order of bytes.
template <typename T>
T LoadNumber(const char* from, bool swapped = false) {
  T value;
  std::memcpy(&value, from, sizeof(T));
  return swapped ? Swapped(value) : value;
}

// It must be there.
template <typename T>
T NumberAt(std::string_view bytes, std::size_t at, bool swapped = false) {
  return LoadNumber<T>(bytes.data() + at, swapped);
}

template <typename T>
void AppendNumber(T value, std::string* bytes) {
  bytes->append(reinterpret_cast<const char*>(&value), sizeof(T));
}

}  // namespace lamina
