// Sees what happens in a folder and all folders below.
//
// Linux' inotify reports files as they are closed by their writer or renamed into place; where it
// cannot be had (no watches left) or is blind (network file systems, where other machines write)
// the caller has to Scan() from time to time: see polls().
//
// Private to io/inbox.
#pragma once

#include <sys/types.h>

#include <chrono>
#include <map>
#include <optional>
#include <string>
#include <unordered_map>
#include <vector>

namespace lamina {

// Hidden folders (leading dot) are passed over, symbolic links to folders are not followed. Folder
// names are relative to the root, "" for the root itself. Not thread-safe but for Interrupt().
class InboxWatcher {
 public:
  enum class How { kFound, kCreated, kWritten, kMovedIn };
  // What is told. `name` is within `folder`; folders are not told of, only what is in them.
  class Events {
   public:
    virtual ~Events() = default;
    virtual void FileSeen(const std::string& folder, const std::string& name, How how) = 0;
    virtual void FileGone(const std::string& folder, const std::string& name) = 0;
    // With all that was below.
    virtual void FolderGone(const std::string& folder) = 0;
    virtual void FolderUnreadable(const std::string& folder, const std::string& reason) = 0;
    // Around a look at everything: files not seen in between are gone.
    virtual void ScanBegins() = 0;
    virtual void ScanEnds() = 0;
  };
  enum class Kind { kAuto, kInotify, kPoll };

  // `root` must be canonical. Throws InputError if it cannot be watched.
  InboxWatcher(std::string root, Kind kind);
  ~InboxWatcher();
  InboxWatcher(const InboxWatcher&) = delete;
  InboxWatcher& operator=(const InboxWatcher&) = delete;

  // Why Scan() must be called now and then; empty if events tell all.
  const std::string& polls() const { return polls_; }

  // Looks at everything. Folders are watched before they are listed, so that nothing that arrives
  // meanwhile is missed. Throws InputError if the root is gone.
  void Scan(Events* events);

  // Throws InputError if the root is gone, or another folder has come in its place.
  void CheckRoot() const;

  // Tells what happened since the last call, without waiting. Throws InputError if the root is
  // gone.
  void Pump(Events* events);

  // Has changes of this file, which may be written to without being closed, told as FileSeen
  // (kWritten), too. No error if there is no such file.
  void WatchFile(const std::string& folder, const std::string& name, const std::string& path);

  // Nothing more is told.
  void Stop();

  enum class Woken { kEvent, kInterrupted, kTimeout };
  // Waits for an event, Interrupt(), a signal (told as kEvent) or the time (none: for ever).
  Woken Wait(std::optional<std::chrono::nanoseconds> timeout);

  // Ends the Wait() that is under way, or else the next. From any thread or signal handler.
  void Interrupt() noexcept;

 private:
  struct Watched {
    std::string folder;
    std::string file;  // of WatchFile
  };
  void OpenInotify(Kind kind);
  [[noreturn]] void FailRoot(const std::string& what) const;
  std::string Absolute(const std::string& folder) const;
  void WatchFolder(const std::string& folder);
  void ScanFolder(const std::string& folder, Events* events);
  void ListFolder(const std::string& folder, Events* events, std::vector<std::string>* below);
  void ForgetFolder(const std::string& folder, Events* events);
  void Handle(int watch, unsigned mask, const std::string& name, Events* events);

  const std::string root_;
  dev_t root_device_ = 0;
  ino_t root_inode_ = 0;
  int inotify_ = -1;
  int wake_ = -1;
  Kind kind_;
  std::string polls_;
  std::unordered_map<int, Watched> watched_;
  std::map<std::string, int> watch_of_folder_;
};

}  // namespace lamina
