// Compressed bytes as a stream: lz4 frames, zstd frames, bz2; several one after the other count as
// one. Checksums that are in the data are checked.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "io/stream/byte_stream.h"

namespace lamina {

enum class Compression { kNone, kLz4, kZstd, kBz2 };

// By the name that a container gives it; "" and "none" are kNone.
std::optional<Compression> CompressionByName(std::string_view name);

// Whether these are the first bytes of a zstd frame.
bool IsZstd(std::string_view bytes);

// What one compression does; takes from `in`, adds to `out`.
class Decoder;

class PackedStream final : public ByteStream {
 public:
  // Up to `bytes` of the compressed data; 0 at its end.
  using Source = std::function<std::size_t(char* to, std::size_t bytes)>;

  // Not for kNone. zstd must not want a window of more than 8 MB, which is that of its levels up to
  // 19.
  PackedStream(std::string name, Compression compression, Source source);
  // Of bytes in memory, which must outlive it.
  PackedStream(std::string name, Compression compression, std::string_view packed);
  ~PackedStream() override;

 private:
  std::size_t Next(char* to, std::size_t bytes) override;

  Source source_;
  std::unique_ptr<Decoder> decoder_;
  std::string read_;        // from the source
  std::string_view input_;  // of it, or all of what is in memory: what is not unpacked yet
  bool source_ended_ = false;
};

// The whole of zstd frames in memory, at most `most` bytes: what is beyond is not unpacked. Throws
// InputError.
ByteBuffer UnpackZstd(const std::string& name, std::string_view packed, std::size_t most);

// A source of a stretch of a file, which must outlive it.
PackedStream::Source SourceOf(const RandomFile& file, std::uint64_t begin, std::uint64_t end);

}  // namespace lamina
