#include "io/container/packed_parts.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <filesystem>

#include "core/base/error.h"
#include "io/container/message_table.h"
#include "io/file/disk_room.h"
#include "io/stream/packed_stream.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

// A file that is gone when this is.
class TemporaryFile {
 public:
  TemporaryFile() {
    std::error_code error;
    path_ = (fs::temp_directory_path(error) / "lamina_unpacked_XXXXXX").string();
    if (error) Fail(error.message().c_str());
    descriptor_ = mkstemp(path_.data());
    if (descriptor_ < 0) Fail(std::strerror(errno));
  }
  ~TemporaryFile() {
    close(descriptor_);
    std::error_code ignored;
    fs::remove(path_, ignored);
  }
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;

  const std::string& path() const { return path_; }

  void Write(std::string_view bytes) {
    while (!bytes.empty()) {
      const ssize_t done = write(descriptor_, bytes.data(), bytes.size());
      if (done < 0 && errno == EINTR) continue;
      if (done <= 0) Fail(std::strerror(errno));
      bytes.remove_prefix(static_cast<std::size_t>(done));
    }
  }

 private:
  [[noreturn]] void Fail(const char* why) const {
    throw InputError(
        fmt::format("{}: a compressed file cannot be unpacked there (TMPDIR names the folder): {}",
                    path_, why));
  }

  std::string path_;
  int descriptor_ = -1;
};

void Unpack(const std::string& path, TemporaryFile* to) {
  // As for chunks: no recording is packed better.
  constexpr std::uint64_t kMostRatio = 1000, kLeastBytes = 16 << 20, kKeepFree = 64 << 20;
  const RandomFile file(path);
  const std::uint64_t most = std::max(kLeastBytes, kMostRatio * file.size());
  PackedStream stream(path, Compression::kZstd, SourceOf(file, 0, file.size()));
  std::string piece(std::size_t{1} << 20, '\0');
  for (bool more = true; more;) {
    const std::uint64_t before = stream.position();
    more = stream.TryRead(piece.data(), piece.size());
    to->Write(std::string_view(piece).substr(0, stream.position() - before));
    if (stream.position() > most) {
      throw InputError(
          fmt::format("{}: {} bytes unpack to more than {}: refused", path, file.size(), most));
    }
    if (FreeBytes(fs::path(to->path()).parent_path().string()) < kKeepFree) {
      throw InputError(
          fmt::format("{}: cannot be unpacked: no room in {} (TMPDIR names the folder)", path,
                      fs::path(to->path()).parent_path().string()));
    }
  }
}

class PackedFile final : public MessageTable {
 public:
  PackedFile(const std::string& path, std::shared_ptr<UnpackedFiles> files,
             const OpenContainerFile& open)
      : MessageTable(files->Get(path, open)->kind() + ", compressed"),
        path_(path),
        files_(std::move(files)),
        open_(open) {
    AddPart(*files_->Get(path_, open_), 0);
    for (std::string& doubt : doubts_) doubt = path + ": " + doubt;
  }

  std::string Read(const MessagePlace& place, std::size_t most) const override {
    return files_->Get(path_, open_)->Read(place, most);
  }
  void With(const MessagePlace& place,
            const std::function<void(std::string_view)>& use) const override {
    files_->Get(path_, open_)->With(place, use);
  }

 private:
  const std::string path_;
  const std::shared_ptr<UnpackedFiles> files_;
  const OpenContainerFile open_;
};

}  // namespace

std::shared_ptr<const MessageContainer> UnpackedFiles::Get(const std::string& path,
                                                           const OpenContainerFile& open) {
  // Scans near the end of a file are read together with those at the beginning of the next.
  constexpr std::size_t kKept = 2;
  const std::lock_guard<std::mutex> lock(mutex_);
  const auto found = std::find_if(last_.begin(), last_.end(),
                                  [&](const Unpacked& file) { return file.path == path; });
  if (found != last_.end()) {
    last_.splice(last_.begin(), last_, found);
    return last_.front().container;
  }
  while (last_.size() >= kKept) last_.pop_back();
  // Without a name once it is open; its bytes are freed when the container is.
  TemporaryFile unpacked;
  Unpack(path, &unpacked);
  last_.push_front({path, open(unpacked.path())});
  return last_.front().container;
}

std::unique_ptr<MessageContainer> OpenPackedFile(const std::string& path,
                                                 std::shared_ptr<UnpackedFiles> files,
                                                 const OpenContainerFile& open) {
  return std::make_unique<PackedFile>(path, std::move(files), open);
}

}  // namespace lamina
