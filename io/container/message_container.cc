#include "io/container/message_container.h"

#include <fmt/format.h>

#include <algorithm>
#include <filesystem>

#include "core/base/error.h"
#include "io/container/chunked_file.h"
#include "io/container/message_table.h"
#include "io/container/packed_parts.h"
#include "io/container/rosbag2_database.h"
#include "io/container/rosbag2_folder.h"
#include "io/stream/byte_stream.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

enum class Kind { kNone, kBag, kMcap, kDatabase, kPacked };

Kind KindByBytes(std::string_view head) {
  const auto begins = [&](std::string_view magic) { return head.substr(0, magic.size()) == magic; };
  if (begins("#ROSBAG V")) return Kind::kBag;
  if (begins("\x89MCAP")) return Kind::kMcap;
  if (begins("SQLite format 3")) return Kind::kDatabase;
  if (IsZstd(head)) return Kind::kPacked;
  return Kind::kNone;
}

std::string HeadOf(const RandomFile& file) {
  std::string head(16, '\0');
  head.resize(file.ReadAt(0, head.data(), head.size()));
  return head;
}

std::unique_ptr<MessageContainer> OpenFile(const std::string& path, const TopicFilter& wanted,
                                           const std::shared_ptr<ChunkCache>& cache,
                                           const std::shared_ptr<UnpackedFiles>& unpacked) {
  switch (KindByBytes(HeadOf(RandomFile(path)))) {
    case Kind::kBag:
      return OpenRos1Bag(path, wanted, cache);
    case Kind::kMcap:
      return OpenMcap(path, wanted, cache);
    case Kind::kDatabase:
      return OpenRosbag2Database(path, wanted);
    case Kind::kPacked:
      if (unpacked == nullptr) break;
      return OpenPackedFile(path, unpacked, [wanted, cache](const std::string& file) {
        return OpenFile(file, wanted, cache, nullptr);
      });
    case Kind::kNone:
      break;
  }
  throw InputError(
      fmt::format("{}: begins like no ROS 1 bag, MCAP file or sqlite3 file of a ROS 2 bag", path));
}

// Files that follow one another as one.
class SplitContainer final : public MessageTable {
 public:
  SplitContainer(std::vector<std::unique_ptr<MessageContainer>> parts, std::string kind)
      : MessageTable(std::move(kind)), parts_(std::move(parts)) {
    for (std::size_t p = 0; p < parts_.size(); ++p) {
      AddPart(*parts_[p], static_cast<std::uint32_t>(p));
    }
    SortMessages();
  }

  std::string Read(const MessagePlace& place, std::size_t most) const override {
    return parts_.at(place.part)->Read(place, most);
  }
  void With(const MessagePlace& place,
            const std::function<void(std::string_view)>& use) const override {
    parts_.at(place.part)->With(place, use);
  }
  void Doubt(std::string text) { doubts_.push_back(std::move(text)); }

 private:
  std::vector<std::unique_ptr<MessageContainer>> parts_;
};

}  // namespace

bool IsMessageContainer(const std::string& path) {
  std::error_code ignored;
  if (fs::is_directory(path, ignored)) return !ContainerFilesIn(path).empty();
  if (!fs::is_regular_file(path, ignored)) return false;
  if (IsContainerName(fs::path(path).filename().string())) return true;
  try {
    return KindByBytes(HeadOf(RandomFile(path))) != Kind::kNone;
  } catch (const InputError&) {
    return false;
  }
}

std::unique_ptr<MessageContainer> OpenMessageContainer(const std::string& path,
                                                       const TopicFilter& wanted) {
  const auto cache = std::make_shared<ChunkCache>();
  const auto unpacked = std::make_shared<UnpackedFiles>();
  std::error_code ignored;
  if (!fs::is_directory(path, ignored)) return OpenFile(path, wanted, cache, unpacked);
  std::vector<std::unique_ptr<MessageContainer>> parts;
  std::vector<std::string> doubts;
  std::string first_error;
  const std::vector<std::string> files = ContainerFilesIn(path);
  if (files.empty()) throw InputError(path + ": holds no bag and no MCAP file");
  // Each keeps a file open.
  constexpr std::size_t kMostFiles = 500;
  if (files.size() > kMostFiles) {
    throw InputError(fmt::format("{}: holds {} files of recordings, at most {} are read as one",
                                 path, files.size(), kMostFiles));
  }
  for (const std::string& file : files) {
    try {
      parts.push_back(OpenFile(file, wanted, cache, unpacked));
    } catch (const InputError& error) {
      doubts.push_back(fmt::format("left out: {}", error.what()));
      if (first_error.empty()) first_error = error.what();
    }
  }
  if (parts.empty()) throw InputError(first_error);
  const std::string kind =
      fmt::format("{}{}", parts.front()->kind(),
                  files.size() == 1 ? "" : fmt::format(" in {} files", files.size()));
  auto all = std::make_unique<SplitContainer>(std::move(parts), kind);
  for (std::string& doubt : doubts) all->Doubt(std::move(doubt));
  return all;
}

}  // namespace lamina
