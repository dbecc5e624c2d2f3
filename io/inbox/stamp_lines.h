// The stamps of a times.txt or timestamps.txt that may still grow while scans arrive.
//
// Private to io/inbox.
#pragma once

#include <sys/types.h>

#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "core/geometry/scan.h"

namespace lamina {

// Lines as ReadStamps counts them (blank ones and comments left out), 8 bytes each. A look costs
// what was added since the last one; only a file that was replaced is read again from its start.
// Never throws: what cannot be read, or is no stamp, is told by Missing().
class StampLines {
 public:
  explicit StampLines(std::string path) : path_(std::move(path)) {}

  // Looks at the file. A last line without its end may be half written: it counts only if `final`.
  // True if something has changed.
  bool Refresh(bool final);

  const std::string& path() const { return path_; }
  bool exists() const { return exists_; }
  std::size_t size() const { return stamps_.size(); }
  // A last line waits for its end.
  bool has_unfinished_line() const { return unfinished_ && !unfinished_counts_; }

  enum class Line { kThere, kMissing, kBad };
  // The stamp of line i, from 0.
  Line At(std::size_t i, StampNs* stamp_ns) const;
  // Why At(i) gave no stamp.
  std::string Missing(std::size_t i) const;

 private:
  void StartAgain();
  bool ReadFrom(std::uint64_t offset, std::string* text);
  void Append(std::string_view lines);

  std::string path_;
  std::string error_;
  std::vector<StampNs> stamps_;
  bool exists_ = false;
  bool unfinished_ = false, unfinished_counts_ = false;
  std::size_t whole_lines_ = 0;  // stamps_ without the unfinished one
  std::uint64_t consumed_ = 0;   // bytes of whole lines
  // What the file was at the last look.
  dev_t device_ = 0;
  ino_t inode_ = 0;
  std::uint64_t size_ = 0;
  std::int64_t modified_ns_ = 0;
};

}  // namespace lamina
