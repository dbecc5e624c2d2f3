// Files of a container that are compressed as a whole (rosbag2's compression_mode FILE): unpacked
// into a temporary file (in TMPDIR) while they are read.
//
// Private to io/container.
#pragma once

#include <functional>
#include <list>
#include <memory>
#include <mutex>
#include <string>

#include "io/container/message_container.h"

namespace lamina {

using OpenContainerFile = std::function<std::unique_ptr<MessageContainer>(const std::string& path)>;

// The few unpacked files that were read last. Thread-safe.
class UnpackedFiles {
 public:
  // The container in `path`, opened by `open` from its unpacked bytes. Throws InputError, also if
  // there is no room for them.
  std::shared_ptr<const MessageContainer> Get(const std::string& path,
                                              const OpenContainerFile& open);

 private:
  struct Unpacked {
    std::string path;
    std::shared_ptr<const MessageContainer> container;
  };
  std::mutex mutex_;
  std::list<Unpacked> last_;  // the newest first
};

// A packed file as a container like any other.
std::unique_ptr<MessageContainer> OpenPackedFile(const std::string& path,
                                                 std::shared_ptr<UnpackedFiles> files,
                                                 const OpenContainerFile& open);

}  // namespace lamina
