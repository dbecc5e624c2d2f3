#include "io/stream/byte_stream.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <optional>

#include "core/base/error.h"
#include "io/file/file_bytes.h"

namespace lamina {
namespace {

thread_local const std::atomic<bool>* given_up = nullptr;

}  // namespace

GiveUpReads::GiveUpReads(const std::atomic<bool>* flag) { given_up = flag; }
GiveUpReads::~GiveUpReads() { given_up = nullptr; }

void ThrowIfGivenUp(const std::string& path) {
  if (given_up != nullptr && *given_up) {
    throw InputError(fmt::format("{}: is not read to its end: it is not wanted any more", path));
  }
}

void ByteBuffer::Reset(std::size_t bytes) {
  if (bytes > capacity_) {
    data_.reset();
    capacity_ = 0;
    data_.reset(new char[bytes]);
    capacity_ = bytes;
  }
  size_ = bytes;
}

ByteBuffer SpareBuffers::Take(std::size_t bytes) {
  ByteBuffer buffer;
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    const auto fits = std::find_if(spare_.begin(), spare_.end(),
                                   [&](const ByteBuffer& b) { return b.capacity() >= bytes; });
    if (fits != spare_.end()) {
      buffer = std::move(*fits);
      spare_.erase(fits);
    }
  }
  // Those of the next scans will be a little longer or shorter.
  if (bytes > buffer.capacity()) buffer.Reset(bytes + bytes / 8);
  buffer.Reset(bytes);
  return buffer;
}

void SpareBuffers::Give(ByteBuffer buffer) {
  constexpr std::size_t kMostBytes = 8 << 20, kMostBuffers = 2;
  if (buffer.capacity() == 0 || buffer.capacity() > kMostBytes) return;
  const std::lock_guard<std::mutex> lock(mutex_);
  if (spare_.size() >= kMostBuffers) spare_.erase(spare_.begin());
  spare_.push_back(std::move(buffer));
}

RandomFile::RandomFile(const std::string& path) : path_(path) {
  const auto fail = [&](const char* reason) {
    throw InputError(fmt::format("{}: cannot be read: {}", path, reason));
  };
  struct stat status = {};
  if (stat(path.c_str(), &status) != 0) fail(std::strerror(errno));
  // Not opened otherwise: that of a pipe could wait for ever.
  if (!S_ISREG(status.st_mode)) fail("not a regular file");
  descriptor_ = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  if (descriptor_ < 0) fail(std::strerror(errno));
  size_ = static_cast<std::uint64_t>(status.st_size);
}

RandomFile::~RandomFile() { close(descriptor_); }

std::size_t RandomFile::ReadAt(std::uint64_t offset, char* to, std::size_t bytes) const {
  ThrowIfGivenUp(path_);
  if (offset >= size_) return 0;
  bytes = static_cast<std::size_t>(std::min<std::uint64_t>(bytes, size_ - offset));
  const std::optional<std::size_t> got = lamina::ReadAt(descriptor_, offset, to, bytes);
  if (!got) throw InputError(fmt::format("{}: cannot be read: {}", path_, std::strerror(errno)));
  return *got;
}

bool ByteStream::TryRead(char* to, std::size_t bytes) {
  std::size_t done = 0;
  while (done < bytes) {
    const std::size_t more = Next(to + done, bytes - done);
    if (more == 0) return false;
    done += more;
    position_ += more;
  }
  return true;
}

void ByteStream::Read(char* to, std::size_t bytes) {
  if (!TryRead(to, bytes)) Fail("ends here, inside a record");
}

void ByteStream::Skip(std::uint64_t bytes) {
  char passed[4096];
  while (bytes > 0) {
    std::uint64_t more = Jump(bytes);
    if (more == 0) more = Next(passed, std::min<std::uint64_t>(bytes, sizeof(passed)));
    if (more == 0) Fail("ends here, inside a record");
    bytes -= more;
    position_ += more;
  }
}

std::string ByteStream::Text(std::uint64_t bytes, std::uint64_t most) {
  if (bytes > most) Fail(fmt::format("a length of {} bytes, must be at most {}", bytes, most));
  constexpr std::uint64_t kPiece = 1 << 20;
  std::string text;
  // Address space alone: memory is taken piece by piece.
  constexpr std::uint64_t kMostReserved = 1 << 30;
  text.reserve(static_cast<std::size_t>(std::min(bytes, kMostReserved)));
  while (text.size() < bytes) {
    const std::size_t have = text.size();
    text.resize(have + static_cast<std::size_t>(std::min(kPiece, bytes - have)));
    Read(text.data() + have, text.size() - have);
  }
  return text;
}

std::string_view ByteStream::View(std::uint64_t bytes, std::uint64_t most, ByteBuffer* room) {
  if (bytes > most) Fail(fmt::format("a length of {} bytes, must be at most {}", bytes, most));
  const auto count = static_cast<std::size_t>(bytes);
  if (const char* there = InMemory(bytes)) {
    position_ += bytes;
    return {there, count};
  }
  room->Reset(count);
  Read(room->data(), count);
  return room->view();
}

std::string ByteStream::ShortText() {
  constexpr std::uint64_t kMost = 1024;
  return Text(Number<std::uint32_t>(), kMost);
}

void ByteStream::Fail(const std::string& what) const {
  throw InputError(fmt::format("{}: byte {}: {}", name_, position_, what));
}

FileStream::FileStream(const RandomFile& file, std::uint64_t begin, std::uint64_t end,
                       std::size_t ahead)
    : ByteStream(file.path()), file_(file), at_(begin), end_(end), ahead_(ahead) {}

std::size_t FileStream::Next(char* to, std::size_t bytes) {
  if (used_ == buffer_.size()) {
    used_ = 0;
    const std::uint64_t left = end_ - std::min(at_, end_);
    buffer_.resize(static_cast<std::size_t>(std::min<std::uint64_t>(left, ahead_)));
    if (bytes >= buffer_.size()) {
      buffer_.clear();
      const std::size_t got =
          file_.ReadAt(at_, to, static_cast<std::size_t>(std::min<std::uint64_t>(bytes, left)));
      at_ += got;
      return got;
    }
    buffer_.resize(file_.ReadAt(at_, buffer_.data(), buffer_.size()));
    at_ += buffer_.size();
  }
  const std::size_t take = std::min(bytes, buffer_.size() - used_);
  std::memcpy(to, buffer_.data() + used_, take);
  used_ += take;
  return take;
}

std::uint64_t FileStream::Jump(std::uint64_t bytes) {
  if (used_ < buffer_.size()) {
    const std::uint64_t take = std::min<std::uint64_t>(bytes, buffer_.size() - used_);
    used_ += static_cast<std::size_t>(take);
    return take;
  }
  const std::uint64_t take =
      std::min(bytes, std::min(end_, file_.size()) - std::min(at_, std::min(end_, file_.size())));
  at_ += take;
  return take;
}

std::size_t MemoryStream::Next(char* to, std::size_t bytes) {
  const std::size_t take = std::min(bytes, left_.size());
  std::memcpy(to, left_.data(), take);
  left_.remove_prefix(take);
  return take;
}

const char* MemoryStream::InMemory(std::uint64_t bytes) {
  if (bytes > left_.size()) return nullptr;
  const char* there = left_.data();
  left_.remove_prefix(static_cast<std::size_t>(bytes));
  return there;
}

std::uint64_t MemoryStream::Jump(std::uint64_t bytes) {
  const std::uint64_t take = std::min<std::uint64_t>(bytes, left_.size());
  left_.remove_prefix(static_cast<std::size_t>(take));
  return take;
}

}  // namespace lamina
