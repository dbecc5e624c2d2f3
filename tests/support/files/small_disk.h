// A file system of a few megabytes, in memory, that a test can fill.
#pragma once

#include <sched.h>
#include <sys/mount.h>

#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <string>

namespace lamina {

// Mounts of this process and its children are seen by no other, and end with them. False unless
// that is allowed (root). A namespace is a thread's own: it must be made before there is a second
// one, which is before main().
inline const bool kOwnMounts =
    unshare(CLONE_NEWNS) == 0 && mount("none", "/", nullptr, MS_REC | MS_PRIVATE, nullptr) == 0;

class SmallDisk {
 public:
  SmallDisk(std::string folder, std::uint64_t bytes) : folder_(std::move(folder)) {
    std::filesystem::create_directories(folder_);
    mounted_ = kOwnMounts && mount("tmpfs", folder_.c_str(), "tmpfs", 0, Size(bytes).c_str()) == 0;
  }
  ~SmallDisk() {
    if (mounted_) umount2(folder_.c_str(), MNT_DETACH);
  }
  SmallDisk(const SmallDisk&) = delete;
  SmallDisk& operator=(const SmallDisk&) = delete;

  bool mounted() const { return mounted_; }
  bool Resize(std::uint64_t bytes) const {
    return mount("tmpfs", folder_.c_str(), "tmpfs", MS_REMOUNT, Size(bytes).c_str()) == 0;
  }
  // Takes all the room that is left, in a file "ballast".
  void Fill() const {
    std::FILE* const ballast = std::fopen((folder_ + "/ballast").c_str(), "ab");
    const std::string block(4096, 'x');
    while (std::fwrite(block.data(), 1, block.size(), ballast) == block.size()) {
    }
    std::fclose(ballast);
  }
  void Empty() const { std::filesystem::remove(folder_ + "/ballast"); }

 private:
  static std::string Size(std::uint64_t bytes) { return "size=" + std::to_string(bytes); }

  std::string folder_;
  bool mounted_ = false;
};

}  // namespace lamina
