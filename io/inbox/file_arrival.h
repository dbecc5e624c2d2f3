// What stands behind a name in the inbox, and whether it is all there.
//
// Private to io/inbox.
#pragma once

#include <cstdint>
#include <string>

namespace lamina {

struct FileLook {
  enum class What {
    kFile,      // a regular file, or a symbolic link to one within the root
    kGone,      // no such name
    kDangling,  // a symbolic link to nothing (yet)
    kFolder,    // a folder, or a symbolic link to one within the root
    kRefused    // anything else: see reason
  };
  What what = What::kGone;
  std::uint64_t size = 0;
  std::int64_t modified_ns = 0;  // wall clock
  // The name came to be by linking: no writer will close it.
  bool linked = false;
  std::string reason;
};

// Looks at root/name. `root` must be canonical. Never throws, and opens nothing but a
// metadata.yaml, whose size and time of change are those of all its files.
FileLook LookAtFile(const std::string& root, const std::string& name);

// Whether a file of `size` bytes, of which it is not known whether it is still written, is all
// there: IsWholeScanFile for one of points, IsWholeRecording for a recording. An empty one is not.
bool IsWhole(const std::string& path, std::uint64_t size);

}  // namespace lamina
