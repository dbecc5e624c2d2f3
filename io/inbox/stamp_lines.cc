#include "io/inbox/stamp_lines.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <limits>

#include "io/file/text_input.h"
#include "io/points/scan_names.h"

namespace lamina {
namespace {

constexpr StampNs kBadStamp = std::numeric_limits<StampNs>::min();

}  // namespace

bool StampLines::Refresh(bool final) {
  struct stat status;
  if (stat(path_.c_str(), &status) != 0 || !S_ISREG(status.st_mode)) {
    // Stamps that were read stay: the scans that they belong to may come later.
    const bool changed = exists_;
    exists_ = false;
    device_ = 0;
    inode_ = 0;
    return changed;
  }
  const std::uint64_t size = static_cast<std::uint64_t>(status.st_size);
  const std::int64_t modified_ns =
      std::int64_t{status.st_mtim.tv_sec} * 1'000'000'000 + status.st_mtim.tv_nsec;
  const bool other = status.st_dev != device_ || status.st_ino != inode_;
  const bool changed = other || !exists_ || size != size_ || modified_ns != modified_ns_;
  const bool finish = final && has_unfinished_line();
  if (!changed && !finish) return false;
  // Of the same size but written since: its beginning is another, too.
  if (other || size < size_ || (size == size_ && modified_ns != modified_ns_)) StartAgain();
  exists_ = true;
  device_ = status.st_dev;
  inode_ = status.st_ino;
  size_ = size;
  modified_ns_ = modified_ns;
  std::string text;
  if (!ReadFrom(consumed_, &text)) return true;
  stamps_.resize(whole_lines_);
  const std::size_t whole = text.rfind('\n') + 1;  // 0 if there is none
  Append(std::string_view(text).substr(0, whole));
  whole_lines_ = stamps_.size();
  consumed_ += whole;
  unfinished_ = whole < text.size();
  unfinished_counts_ = unfinished_ && final;
  if (unfinished_counts_) Append(std::string_view(text).substr(whole));
  return true;
}

StampLines::Line StampLines::At(std::size_t i, StampNs* stamp_ns) const {
  if (i >= stamps_.size()) return Line::kMissing;
  *stamp_ns = stamps_[i];
  return *stamp_ns == kBadStamp ? Line::kBad : Line::kThere;
}

std::string StampLines::Missing(std::size_t i) const {
  if (!error_.empty()) return error_;
  StampNs ignored = 0;
  if (At(i, &ignored) == Line::kBad) {
    return fmt::format(
        "{}: stamp {} must be seconds or a date and time like 2011-09-26 13:02:25.594360375", path_,
        i + 1);
  }
  return fmt::format("{}: ends after {} stamps, stamp {} is wanted", path_, stamps_.size(), i + 1);
}

void StampLines::StartAgain() {
  stamps_.clear();
  whole_lines_ = 0;
  consumed_ = 0;
  unfinished_ = unfinished_counts_ = false;
}

bool StampLines::ReadFrom(std::uint64_t offset, std::string* text) {
  const int file = open(path_.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
  ssize_t got = -1;
  if (file >= 0) {
    char buffer[1 << 16];
    while ((got = pread(file, buffer, sizeof(buffer), static_cast<off_t>(offset))) > 0) {
      text->append(buffer, static_cast<std::size_t>(got));
      offset += static_cast<std::uint64_t>(got);
    }
  }
  error_ = got < 0 ? fmt::format("{}: cannot be read: {}", path_, std::strerror(errno)) : "";
  if (file >= 0) close(file);
  return got == 0;
}

void StampLines::Append(std::string_view lines) {
  LineReader reader(path_, lines);
  while (reader.Next()) {
    StampNs stamp_ns = 0;
    stamps_.push_back(ParseStamp(reader.line(), &stamp_ns) ? stamp_ns : kBadStamp);
  }
}

}  // namespace lamina
