#include "io/store/byte_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>
#include <utility>

#include "core/base/error.h"
#include "io/file/checksum.h"
#include "io/file/disk_room.h"
#include "io/file/file_bytes.h"
#include "io/file/file_writer.h"

namespace lamina {

namespace fs = std::filesystem;

ByteFile::ByteFile(std::string path, Lifetime lifetime)
    : path_(std::move(path)), lifetime_(lifetime) {
  if (lifetime_ == Lifetime::kScratch) return;
  if (lifetime_ == Lifetime::kKept) {
    Make();
    SyncFolder(fs::absolute(path_).parent_path().string());
  } else {
    file_ = open(path_.c_str(), O_RDONLY | O_CLOEXEC);
  }
  struct stat status {};
  if (file_ >= 0 && fstat(file_, &status) == 0) size_ = static_cast<std::uint64_t>(status.st_size);
}

ByteFile::~ByteFile() {
  if (file_ >= 0) close(file_);
}

void ByteFile::Make() {
  const bool scratch = lifetime_ == Lifetime::kScratch;
  constexpr mode_t kAsOthers = 0644, kOwnerOnly = 0600;
  file_ = open(path_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | (scratch ? O_TRUNC | O_NOFOLLOW : 0),
               scratch ? kOwnerOnly : kAsOthers);
  if (file_ < 0) ThrowNotWritten(path_, "cannot be created", errno);
  if (scratch) unlink(path_.c_str());
}

std::optional<StoredBytes> ByteFile::Append(std::string_view bytes) {
  if (lifetime_ == Lifetime::kReadOnly) return std::nullopt;
  if (file_ < 0) Make();
  const StoredBytes place = {size_, bytes.size(), Crc32(bytes)};
  if (!WriteAt(file_, size_, bytes)) ThrowNotWritten(path_, "cannot be written", errno);
  size_ += bytes.size();
  return place;
}

bool ByteFile::Read(const StoredBytes& place, char* to) const {
  const bool whole = ReadAt(file_, place.at, to, place.size) == place.size &&
                     Crc32({to, place.size}) == place.checksum;
  if (!whole) ++damaged_;
  return whole;
}

void ByteFile::RollBackTo(std::uint64_t size) {
  if (size > size_) {
    throw InputError(
        fmt::format("{}: has lost its end: {} bytes of {} are there", path_, size_, size));
  }
  if (lifetime_ == Lifetime::kReadOnly || size == size_) return;
  if (ftruncate(file_, static_cast<off_t>(size)) != 0)
    ThrowNotWritten(path_, "cannot be shortened", errno);
  size_ = size;
}

void ByteFile::KeepOnly(const std::vector<StoredBytes>& places) {
  if (file_ < 0 || lifetime_ == Lifetime::kReadOnly) return;
  std::vector<StoredBytes> kept = places;
  std::sort(kept.begin(), kept.end(),
            [](const StoredBytes& a, const StoredBytes& b) { return a.at < b.at; });
  std::uint64_t end = 0;
  for (const StoredBytes& place : kept) {
    // A failure is no harm: the room is not given back.
    if (place.at > end) {
      fallocate(file_, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, static_cast<off_t>(end),
                static_cast<off_t>(place.at - end));
    }
    end = std::max(end, place.at + place.size);
  }
}

void ByteFile::SyncToDisk() const {
  if (file_ < 0) return;
  if (fdatasync(file_) != 0) ThrowNotWritten(path_, "cannot be written", errno);
}

}  // namespace lamina
