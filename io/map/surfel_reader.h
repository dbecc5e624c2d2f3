// Reads the surfels that SurfelWriter (io/map/map_io.h) wrote as PLY, one by one, in bounded
// memory.
//
// Binary little-endian, one element `vertex` of properties without lists. Needed are, in any order
// and among any others: float x y z nx ny nz l1 l2 l3, uint count. Not thread-safe.
#pragma once

#include <array>
#include <cstddef>
#include <string>

#include "core/map/surfel.h"
#include "io/file/text_input.h"

namespace lamina {

class SurfelReader {
 public:
  // Throws InputError naming file and rule: no such file, another format, a property that is
  // missing or of another type, fewer bytes than the header announces.
  explicit SurfelReader(const std::string& path);

  // Surfels in the file.
  std::size_t size() const { return count_; }

  // The next one; false at the end. Throws InputError for one that is not finite.
  bool Next(Surfel* surfel);

 private:
  static constexpr std::size_t kFields = 10;  // x y z nx ny nz l1 l2 l3 count

  void ReadHeader(const std::string& text);
  [[noreturn]] void Fail(const std::string& what) const;

  std::string path_;
  InputFile file_;
  std::size_t count_ = 0, next_ = 0;
  std::size_t record_bytes_ = 0;
  std::array<std::size_t, kFields> offsets_{};
  std::string buffer_;
  std::size_t at_ = 0;          // in the buffer
  std::size_t bytes_left_ = 0;  // of the file, behind the buffer
};

}  // namespace lamina
