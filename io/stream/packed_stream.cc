#include "io/stream/packed_stream.h"

#include <bzlib.h>
#include <fmt/format.h>
#include <lz4frame.h>
#include <zstd.h>

#include <algorithm>
#include <new>

#include "core/base/error.h"

namespace lamina {

class Decoder {
 public:
  struct Step {
    std::size_t consumed = 0, produced = 0;
    const char* error = nullptr;
  };
  virtual ~Decoder() = default;
  virtual Step Run(const char* in, std::size_t in_bytes, char* out, std::size_t out_bytes) = 0;
};

namespace {

class Lz4Decoder final : public Decoder {
 public:
  Lz4Decoder() {
    if (LZ4F_isError(LZ4F_createDecompressionContext(&context_, LZ4F_VERSION))) {
      throw std::bad_alloc();
    }
  }
  ~Lz4Decoder() override { LZ4F_freeDecompressionContext(context_); }

  Step Run(const char* in, std::size_t in_bytes, char* out, std::size_t out_bytes) override {
    Step step{in_bytes, out_bytes, nullptr};
    const std::size_t result =
        LZ4F_decompress(context_, out, &step.produced, in, &step.consumed, nullptr);
    if (LZ4F_isError(result)) step.error = LZ4F_getErrorName(result);
    return step;
  }

 private:
  LZ4F_dctx* context_ = nullptr;
};

class ZstdDecoder final : public Decoder {
 public:
  ZstdDecoder() : context_(ZSTD_createDCtx()) {
    if (context_ == nullptr) throw std::bad_alloc();
    constexpr int kWindowLogMax = 23;
    ZSTD_DCtx_setParameter(context_, ZSTD_d_windowLogMax, kWindowLogMax);
  }
  ~ZstdDecoder() override { ZSTD_freeDCtx(context_); }

  Step Run(const char* in, std::size_t in_bytes, char* out, std::size_t out_bytes) override {
    ZSTD_inBuffer input{in, in_bytes, 0};
    ZSTD_outBuffer output{out, out_bytes, 0};
    const std::size_t result = ZSTD_decompressStream(context_, &output, &input);
    Step step{input.pos, output.pos, nullptr};
    if (ZSTD_isError(result) != 0) step.error = ZSTD_getErrorName(result);
    return step;
  }

 private:
  ZSTD_DCtx* context_;
};

class Bz2Decoder final : public Decoder {
 public:
  Bz2Decoder() { Begin(); }
  ~Bz2Decoder() override { BZ2_bzDecompressEnd(&stream_); }

  Step Run(const char* in, std::size_t in_bytes, char* out, std::size_t out_bytes) override {
    if (ended_ && in_bytes > 0) {
      BZ2_bzDecompressEnd(&stream_);
      Begin();
    }
    if (ended_) return {};
    // Counts of the library are 32 bits; the rest comes with the next call.
    constexpr std::size_t kMost = 1 << 30;
    const auto given = static_cast<unsigned int>(std::min(in_bytes, kMost));
    const auto room = static_cast<unsigned int>(std::min(out_bytes, kMost));
    stream_.next_in = const_cast<char*>(in);
    stream_.avail_in = given;
    stream_.next_out = out;
    stream_.avail_out = room;
    const int result = BZ2_bzDecompress(&stream_);
    ended_ = result == BZ_STREAM_END;
    Step step{given - stream_.avail_in, room - stream_.avail_out, nullptr};
    if (result != BZ_OK && !ended_) step.error = "bz2 data is damaged";
    return step;
  }

 private:
  void Begin() {
    stream_ = {};
    ended_ = false;
    if (BZ2_bzDecompressInit(&stream_, 0, 0) != BZ_OK) throw std::bad_alloc();
  }

  bz_stream stream_ = {};
  bool ended_ = false;
};

std::unique_ptr<Decoder> MakeDecoder(Compression compression) {
  switch (compression) {
    case Compression::kLz4:
      return std::make_unique<Lz4Decoder>();
    case Compression::kZstd:
      return std::make_unique<ZstdDecoder>();
    case Compression::kBz2:
      return std::make_unique<Bz2Decoder>();
    case Compression::kNone:
      break;
  }
  throw std::logic_error("a stream that is not compressed needs no decoder");
}

}  // namespace

std::optional<Compression> CompressionByName(std::string_view name) {
  if (name.empty() || name == "none") return Compression::kNone;
  if (name == "lz4") return Compression::kLz4;
  if (name == "zstd") return Compression::kZstd;
  if (name == "bz2") return Compression::kBz2;
  return std::nullopt;
}

bool IsZstd(std::string_view bytes) { return bytes.substr(0, 4) == "\x28\xB5\x2F\xFD"; }

PackedStream::PackedStream(std::string name, Compression compression, Source source)
    : ByteStream(std::move(name)), source_(std::move(source)), decoder_(MakeDecoder(compression)) {}

PackedStream::~PackedStream() = default;

PackedStream::PackedStream(std::string name, Compression compression, std::string_view packed)
    : ByteStream(std::move(name)),
      decoder_(MakeDecoder(compression)),
      input_(packed),
      source_ended_(true) {}

std::size_t PackedStream::Next(char* to, std::size_t bytes) {
  constexpr std::size_t kInput = 1 << 18;
  for (;;) {
    if (input_.empty() && !source_ended_) {
      read_.resize(kInput);
      input_ = std::string_view(read_).substr(0, source_(read_.data(), kInput));
      source_ended_ = input_.empty();
    }
    const Decoder::Step step = decoder_->Run(input_.data(), input_.size(), to, bytes);
    if (step.error != nullptr) Fail(fmt::format("cannot be unpacked: {}", step.error));
    input_.remove_prefix(step.consumed);
    if (step.produced > 0) return step.produced;
    if (step.consumed > 0) continue;
    if (input_.empty() && source_ended_) return 0;
    if (!input_.empty()) Fail("cannot be unpacked: the data is damaged");
  }
}

ByteBuffer UnpackZstd(const std::string& name, std::string_view packed, std::size_t most) {
  PackedStream stream(name, Compression::kZstd, packed);
  // What the first frame says of its length, which may be wrong; further ones may follow. Address
  // space alone: memory is taken for what arrives.
  constexpr std::size_t kPiece = 1 << 20, kMostTold = 1 << 30;
  const unsigned long long told = ZSTD_getFrameContentSize(packed.data(), packed.size());
  const bool known = told != ZSTD_CONTENTSIZE_UNKNOWN && told != ZSTD_CONTENTSIZE_ERROR;
  ByteBuffer bytes(
      std::min(most, known && told <= kMostTold ? static_cast<std::size_t>(told) + 1 : kPiece));
  std::size_t have = 0;
  for (;;) {
    const std::uint64_t before = stream.position();
    const bool full = stream.TryRead(bytes.data() + have, bytes.size() - have);
    have += static_cast<std::size_t>(stream.position() - before);
    if (!full || have == most) break;
    ByteBuffer larger(std::min(most, 2 * have + kPiece));
    std::memcpy(larger.data(), bytes.data(), have);
    bytes = std::move(larger);
  }
  bytes.Shorten(have);
  return bytes;
}

PackedStream::Source SourceOf(const RandomFile& file, std::uint64_t begin, std::uint64_t end) {
  return [&file, at = begin, end](char* to, std::size_t most) mutable {
    const auto left = end - std::min(at, end);
    const std::size_t got =
        file.ReadAt(at, to, static_cast<std::size_t>(std::min<std::uint64_t>(most, left)));
    at += got;
    return got;
  };
}

}  // namespace lamina
