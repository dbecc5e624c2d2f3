#include "io/inbox/watcher.h"

#include <dirent.h>
#include <fmt/format.h>
#include <linux/magic.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/inotify.h>
#include <sys/stat.h>
#include <sys/vfs.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <iterator>
#include <memory>

#include "core/base/error.h"

namespace lamina {
namespace {

constexpr std::uint32_t kFolderMask = IN_CREATE | IN_CLOSE_WRITE | IN_MOVED_TO | IN_MOVED_FROM |
                                      IN_DELETE | IN_DELETE_SELF | IN_MOVE_SELF | IN_ONLYDIR |
                                      IN_DONT_FOLLOW | IN_EXCL_UNLINK;

// File systems on which other machines (or a process of the user's) may write unseen.
const char* BlindFileSystem(const std::string& path) {
  struct statfs status;
  if (statfs(path.c_str(), &status) != 0) return nullptr;
  switch (static_cast<unsigned long>(status.f_type) & 0xffffffffUL) {
    case NFS_SUPER_MAGIC:
      return "NFS";
    case SMB_SUPER_MAGIC:
    case 0xff534d42UL:  // CIFS
    case 0xfe534d42UL:  // SMB2
      return "SMB";
    case 0x65735546UL:
      return "FUSE";
    case V9FS_MAGIC:
      return "9P";
    case AFS_SUPER_MAGIC:
    case CODA_SUPER_MAGIC:
    case 0x00c36400UL:  // Ceph
      return "a network";
    default:
      return nullptr;
  }
}

std::string Join(const std::string& folder, const std::string& name) {
  return folder.empty() ? name : folder + "/" + name;
}

bool IsBelow(const std::string& folder, const std::string& above) {
  return folder.size() > above.size() && folder.compare(0, above.size(), above) == 0 &&
         (above.empty() || folder[above.size()] == '/');
}

}  // namespace

InboxWatcher::InboxWatcher(std::string root, Kind kind) : root_(std::move(root)), kind_(kind) {
  struct stat status;
  if (stat(root_.c_str(), &status) != 0) {
    throw InputError(fmt::format("{}: cannot be watched: {}", root_, std::strerror(errno)));
  }
  if (!S_ISDIR(status.st_mode)) {
    throw InputError(fmt::format("{}: cannot be watched: is not a folder", root_));
  }
  root_device_ = status.st_dev;
  root_inode_ = status.st_ino;
  wake_ = eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
  if (wake_ < 0) {
    throw InputError(fmt::format("{}: cannot be watched: {}", root_, std::strerror(errno)));
  }
  try {
    OpenInotify(kind);
  } catch (...) {
    close(wake_);
    throw;
  }
}

InboxWatcher::~InboxWatcher() {
  Stop();
  close(wake_);
}

void InboxWatcher::OpenInotify(Kind kind) {
  const char* blind = kind == Kind::kAuto ? BlindFileSystem(root_) : nullptr;
  if (kind == Kind::kPoll) polls_ = "asked to";
  if (blind != nullptr) polls_ = fmt::format("{} file systems do not tell of files", blind);
  if (!polls_.empty()) return;
  inotify_ = inotify_init1(IN_NONBLOCK | IN_CLOEXEC);
  if (inotify_ >= 0) return;
  if (kind == Kind::kInotify) {
    throw InputError(fmt::format("{}: inotify cannot be had: {}", root_, std::strerror(errno)));
  }
  polls_ = fmt::format("inotify cannot be had: {}", std::strerror(errno));
}

std::string InboxWatcher::Absolute(const std::string& folder) const {
  return folder.empty() ? root_ : root_ + "/" + folder;
}

void InboxWatcher::FailRoot(const std::string& what) const {
  throw InputError(fmt::format("{}: the inbox is gone: {}", root_, what));
}

void InboxWatcher::CheckRoot() const {
  struct stat status;
  if (stat(root_.c_str(), &status) != 0) FailRoot(std::strerror(errno));
  if (status.st_dev != root_device_ || status.st_ino != root_inode_) {
    FailRoot("another folder is in its place (was it unmounted?)");
  }
}

void InboxWatcher::Scan(Events* events) {
  CheckRoot();
  events->ScanBegins();
  ScanFolder("", events);
  // A folder that was unmounted meanwhile looks empty.
  CheckRoot();
  events->ScanEnds();
}

void InboxWatcher::WatchFolder(const std::string& folder) {
  if (inotify_ < 0) return;
  const int watch = inotify_add_watch(inotify_, Absolute(folder).c_str(), kFolderMask);
  if (watch >= 0) {
    watched_[watch] = {folder, ""};
    watch_of_folder_[folder] = watch;
    return;
  }
  if (errno == ENOENT || errno == ENOTDIR || errno == ELOOP || errno == EACCES) return;
  const std::string reason =
      errno == ENOSPC ? "no watches are left (fs.inotify.max_user_watches)" : std::strerror(errno);
  if (kind_ == Kind::kInotify) {
    throw InputError(fmt::format("{}: cannot be watched: {}", Absolute(folder), reason));
  }
  polls_ = fmt::format("{}: {}", Absolute(folder), reason);
}

void InboxWatcher::ScanFolder(const std::string& folder, Events* events) {
  std::vector<std::string> open = {folder};
  while (!open.empty()) {
    const std::string next = std::move(open.back());
    open.pop_back();
    WatchFolder(next);
    ListFolder(next, events, &open);
  }
}

void InboxWatcher::ListFolder(const std::string& folder, Events* events,
                              std::vector<std::string>* below) {
  struct Close {
    void operator()(DIR* dir) const { closedir(dir); }
  };
  const std::unique_ptr<DIR, Close> dir(opendir(Absolute(folder).c_str()));
  if (dir == nullptr) {
    if (folder.empty()) {
      throw InputError(fmt::format("{}: cannot be read: {}", root_, std::strerror(errno)));
    }
    if (errno != ENOENT && errno != ENOTDIR) {
      events->FolderUnreadable(folder, std::strerror(errno));
    }
    return;
  }
  while (const dirent* entry = readdir(dir.get())) {
    const std::string name = entry->d_name;
    if (name[0] == '.') continue;
    bool is_folder = entry->d_type == DT_DIR;
    if (entry->d_type == DT_UNKNOWN) {
      struct stat status;
      is_folder =
          lstat((Absolute(folder) + "/" + name).c_str(), &status) == 0 && S_ISDIR(status.st_mode);
    }
    if (is_folder) {
      below->push_back(Join(folder, name));
    } else {
      events->FileSeen(folder, name, How::kFound);
    }
  }
}

void InboxWatcher::ForgetFolder(const std::string& folder, Events* events) {
  // All below stand behind it, among others such as `folder-2`.
  auto it = watch_of_folder_.lower_bound(folder);
  while (it != watch_of_folder_.end() && it->first.compare(0, folder.size(), folder) == 0) {
    if (it->first != folder && !IsBelow(it->first, folder)) {
      ++it;
      continue;
    }
    inotify_rm_watch(inotify_, it->second);
    watched_.erase(it->second);
    it = watch_of_folder_.erase(it);
  }
  events->FolderGone(folder);
}

void InboxWatcher::Pump(Events* events) {
  if (inotify_ < 0) return;
  bool overflow = false;
  // As much as the kernel keeps; a writer that never rests shall not keep us here.
  constexpr int kMostReads = 64;
  alignas(inotify_event) char buffer[1 << 17];
  for (int reads = 0; reads < kMostReads; ++reads) {
    const ssize_t got = read(inotify_, buffer, sizeof(buffer));
    if (got <= 0) break;
    for (const char* at = buffer; at < buffer + got;) {
      const auto* event = reinterpret_cast<const inotify_event*>(at);
      at += sizeof(inotify_event) + event->len;
      if ((event->mask & IN_Q_OVERFLOW) != 0) {
        overflow = true;
      } else {
        Handle(event->wd, event->mask, event->len > 0 ? event->name : "", events);
      }
    }
  }
  if (overflow) Scan(events);
}

void InboxWatcher::Handle(int watch, unsigned mask, const std::string& name, Events* events) {
  const auto found = watched_.find(watch);
  if (found == watched_.end()) return;
  const Watched watched = found->second;
  if ((mask & IN_IGNORED) != 0) {
    // A folder that came again under its name has a newer watch.
    const auto folder = watch_of_folder_.find(watched.folder);
    if (watched.file.empty() && folder != watch_of_folder_.end() && folder->second == watch) {
      watch_of_folder_.erase(folder);
    }
    watched_.erase(found);
    return;
  }
  if (!watched.file.empty()) {
    if ((mask & IN_MODIFY) != 0) events->FileSeen(watched.folder, watched.file, How::kWritten);
    return;
  }
  if (watched.folder.empty()) {
    if ((mask & IN_UNMOUNT) != 0) FailRoot("it was unmounted");
    if ((mask & IN_DELETE_SELF) != 0) FailRoot("it was deleted");
    if ((mask & IN_MOVE_SELF) != 0) FailRoot("it was moved or renamed");
  }
  if (name.empty() || name[0] == '.') return;
  const bool came = (mask & (IN_CREATE | IN_MOVED_TO)) != 0;
  const bool left = (mask & (IN_DELETE | IN_MOVED_FROM)) != 0;
  if ((mask & IN_ISDIR) != 0) {
    if (left) ForgetFolder(Join(watched.folder, name), events);
    if (came) ScanFolder(Join(watched.folder, name), events);
  } else if (left) {
    events->FileGone(watched.folder, name);
  } else if ((mask & IN_CLOSE_WRITE) != 0) {
    events->FileSeen(watched.folder, name, How::kWritten);
  } else if (came) {
    events->FileSeen(watched.folder, name, (mask & IN_CREATE) != 0 ? How::kCreated : How::kMovedIn);
  }
}

void InboxWatcher::WatchFile(const std::string& folder, const std::string& name,
                             const std::string& path) {
  if (inotify_ < 0) return;
  const int watch = inotify_add_watch(inotify_, path.c_str(), IN_MODIFY);
  if (watch >= 0) watched_[watch] = {folder, name};
}

void InboxWatcher::Stop() {
  if (inotify_ >= 0) close(inotify_);
  inotify_ = -1;
  watched_.clear();
  watch_of_folder_.clear();
}

InboxWatcher::Woken InboxWatcher::Wait(std::optional<std::chrono::nanoseconds> timeout) {
  pollfd fds[] = {{wake_, POLLIN, 0}, {inotify_, POLLIN, 0}};  // poll passes over -1
  timespec time = {};
  if (timeout) {
    const auto ns = std::max<std::int64_t>(timeout->count(), 0);
    time.tv_sec = static_cast<std::time_t>(ns / 1'000'000'000);
    time.tv_nsec = static_cast<long>(ns % 1'000'000'000);
  }
  const int ready = ppoll(fds, std::size(fds), timeout ? &time : nullptr, nullptr);
  if (ready == 0) return Woken::kTimeout;
  if (ready < 0 || (fds[0].revents & POLLIN) == 0) return Woken::kEvent;
  std::uint64_t count = 0;
  static_cast<void>(!read(wake_, &count, sizeof(count)));
  return Woken::kInterrupted;
}

void InboxWatcher::Interrupt() noexcept {
  const int error = errno;  // of the code that a signal interrupts
  const std::uint64_t one = 1;
  static_cast<void>(!write(wake_, &one, sizeof(one)));
  errno = error;
}

}  // namespace lamina
