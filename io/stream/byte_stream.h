// Bytes of a file in order, from where they are: on disk, in memory, or compressed.
//
// All numbers in containers are little-endian. What a file says of its own lengths is never
// trusted: memory is taken only for bytes that have arrived.
#pragma once

#include <atomic>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <memory>
#include <mutex>
#include <string>
#include <string_view>
#include <vector>

namespace lamina {

static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "numbers are read as they lie in files");

// While it lives, reading files on this thread ends with an InputError once the flag is true. For
// work of which the result is not wanted any more.
class GiveUpReads {
 public:
  explicit GiveUpReads(const std::atomic<bool>* flag);
  ~GiveUpReads();
  GiveUpReads(const GiveUpReads&) = delete;
  GiveUpReads& operator=(const GiveUpReads&) = delete;
};
// Throws that error, naming the path, if it is.
void ThrowIfGivenUp(const std::string& path);

// Bytes in memory that are not set before they are written: of what is never written no memory is
// taken.
class ByteBuffer {
 public:
  ByteBuffer() = default;
  explicit ByteBuffer(std::size_t bytes) { Reset(bytes); }
  char* data() { return data_.get(); }
  std::size_t size() const { return size_; }
  std::size_t capacity() const { return capacity_; }
  void Shorten(std::size_t bytes) { size_ = bytes; }
  // What was in it is lost.
  void Reset(std::size_t bytes);
  std::string_view view() const { return {data_.get(), size_}; }

 private:
  std::unique_ptr<char[]> data_;
  std::size_t size_ = 0, capacity_ = 0;
};

// Buffers that were used and will be again: the system hands out memory page by page, which for
// that of a scan costs as much as to read it. Thread-safe.
class SpareBuffers {
 public:
  ByteBuffer Take(std::size_t bytes);
  void Give(ByteBuffer buffer);

 private:
  std::mutex mutex_;
  std::vector<ByteBuffer> spare_;
};

// A regular file that is read at any place. Thread-safe.
class RandomFile {
 public:
  // Throws InputError naming the path and the system's reason.
  explicit RandomFile(const std::string& path);
  ~RandomFile();
  RandomFile(const RandomFile&) = delete;
  RandomFile& operator=(const RandomFile&) = delete;

  const std::string& path() const { return path_; }
  // When it was opened.
  std::uint64_t size() const { return size_; }
  // As many bytes as there are from `offset` on, at most `bytes`. Throws InputError.
  std::size_t ReadAt(std::uint64_t offset, char* to, std::size_t bytes) const;

 private:
  std::string path_;
  std::uint64_t size_ = 0;
  int descriptor_ = -1;
};

// Bytes one after the other. Not thread-safe. All throw InputError, which names `name`, the place
// and what is wrong.
class ByteStream {
 public:
  explicit ByteStream(std::string name) : name_(std::move(name)) {}
  virtual ~ByteStream() = default;
  ByteStream(const ByteStream&) = delete;
  ByteStream& operator=(const ByteStream&) = delete;

  // Bytes read or skipped so far.
  std::uint64_t position() const { return position_; }

  // False if the stream ends before.
  bool TryRead(char* to, std::size_t bytes);
  void Read(char* to, std::size_t bytes);
  void Skip(std::uint64_t bytes);
  // `most`: the rule that a length from a file must keep.
  std::string Text(std::uint64_t bytes, std::uint64_t most);
  // The same without a copy where the bytes lie in memory, else in `room`.
  std::string_view View(std::uint64_t bytes, std::uint64_t most, ByteBuffer* room);
  // A text behind its length in 4 bytes.
  std::string ShortText();

  template <typename T>
  T Number() {
    T value;
    Read(reinterpret_cast<char*>(&value), sizeof(T));
    return value;
  }

  [[noreturn]] void Fail(const std::string& what) const;

 protected:
  // Up to `bytes`, at least one; 0 at the end.
  virtual std::size_t Next(char* to, std::size_t bytes) = 0;
  // The next bytes where they lie in memory for as long as the stream, passed over; null if they
  // do not.
  virtual const char* InMemory(std::uint64_t) { return nullptr; }
  // Passes over up to so many bytes without reading them; 0 if it cannot.
  virtual std::uint64_t Jump(std::uint64_t) { return 0; }

 private:
  std::string name_;
  std::uint64_t position_ = 0;
};

// A stretch of a file, which must outlive it. Reads ahead by `ahead` bytes.
class FileStream final : public ByteStream {
 public:
  FileStream(const RandomFile& file, std::uint64_t begin, std::uint64_t end,
             std::size_t ahead = 1 << 12);

 private:
  std::size_t Next(char* to, std::size_t bytes) override;
  std::uint64_t Jump(std::uint64_t bytes) override;

  const RandomFile& file_;
  std::uint64_t at_, end_;  // of what is not in the buffer
  std::size_t ahead_;
  std::string buffer_;
  std::size_t used_ = 0;  // of the buffer
};

// Bytes in memory, which must outlive it.
class MemoryStream final : public ByteStream {
 public:
  MemoryStream(std::string name, std::string_view bytes)
      : ByteStream(std::move(name)), left_(bytes) {}

 private:
  std::size_t Next(char* to, std::size_t bytes) override;
  std::uint64_t Jump(std::uint64_t bytes) override;
  const char* InMemory(std::uint64_t bytes) override;

  std::string_view left_;
};

}  // namespace lamina
