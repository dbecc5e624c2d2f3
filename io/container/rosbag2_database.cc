#include "io/container/rosbag2_database.h"

#include <fmt/format.h>
#include <sqlite3.h>

#include <algorithm>
#include <limits>
#include <map>
#include <mutex>
#include <tuple>

#include "core/base/error.h"
#include "io/container/message_table.h"
#include "io/container/whole_pages.h"
#include "io/file/sqlite_file.h"
#include "io/stream/byte_stream.h"
#include "io/stream/packed_stream.h"

namespace lamina {
namespace {

class Rosbag2Database final : public MessageTable {
 public:
  Rosbag2Database(const std::string& path, const TopicFilter& wanted)
      : MessageTable("a ROS 2 bag (sqlite3)"), path_(path) {
    try {
      Open();
      Prepare();
      ReadTopics();
    } catch (const SQLite::Exception& error) {
      throw InputError(fmt::format("{}: cannot be read: {}", path, error.what()));
    }
    try {
      ReadMessages(wanted);
    } catch (const SQLite::Exception& error) {
      if (doubts_.empty()) {
        doubts_.push_back(
            fmt::format("{}: is damaged and was read as far as it goes: {}", path, error.what()));
      }
    }
    for (std::vector<MessagePlace>& places : messages_) {
      std::sort(places.begin(), places.end(), [](const MessagePlace& a, const MessagePlace& b) {
        return std::tie(a.log_ns, a.offset) < std::tie(b.log_ns, b.offset);
      });
    }
  }

  std::string Read(const MessagePlace& place, std::size_t most) const override {
    return std::string(Bytes(place, most).view());
  }
  void With(const MessagePlace& place,
            const std::function<void(std::string_view)>& use) const override {
    use(Bytes(place, SIZE_MAX).view());
  }

 private:
  // What is asked for if only the beginning of a message is wanted.
  static constexpr std::size_t kFirstBytes = 4096;

  void Open() {
    const std::uint64_t bytes = RandomFile(path_).size(), declared = DeclaredSqliteBytes(path_);
    if (bytes >= declared) {
      database_ = std::make_unique<SQLite::Database>(OpenUntouched(path_));
      return;
    }
    doubts_.push_back(
        fmt::format("{}: is cut off: has {} of {} bytes; it is read as far as it goes", path_,
                    bytes, declared));
    database_ = std::make_unique<SQLite::Database>(
        UntouchedUri(path_), SQLite::OPEN_READONLY | SQLite::OPEN_URI, 0, WholePagesVfs());
  }

  void Prepare() const {
    // What a file says of itself runs nothing, and its pages take no memory to speak of.
    for (const char* pragma :
         {"PRAGMA trusted_schema=OFF", "PRAGMA cache_size=-512", "PRAGMA cell_size_check=ON"}) {
      SQLite::Statement statement(*database_, pragma);
      while (statement.executeStep()) {
      }
    }
    sqlite3_limit(database_->getHandle(), SQLITE_LIMIT_LENGTH, static_cast<int>(kMostMessageBytes));
    SQLite::Statement tables(*database_,
                             "SELECT COUNT(*) FROM sqlite_master WHERE type = 'table' AND "
                             "name IN ('topics', 'messages')");
    tables.executeStep();
    if (tables.getColumn(0).getInt() != 2) {
      throw InputError(path_ + ": has no tables `topics` and `messages`: no ROS 2 bag");
    }
  }

  void ReadTopics() {
    SQLite::Statement rows(*database_, "SELECT id, name, type, serialization_format FROM topics");
    while (rows.executeStep()) {
      if (topics_.size() >= kMostTopics) {
        throw InputError(fmt::format("{}: more than {} topics: not read", path_, kMostTopics));
      }
      MessageTopic topic;
      topic.name = rows.getColumn(1).getString();
      topic.type = Ros1TypeName(rows.getColumn(2).getString());
      constexpr std::size_t kMostNameBytes = 1024;
      if (topic.name.size() > kMostNameBytes || topic.type.size() > kMostNameBytes) {
        throw InputError(path_ + ": the name of a topic has more than 1024 bytes");
      }
      if (rows.getColumn(3).getString() == "cdr") topic.encoding = MessageEncoding::kCdr;
      by_id_[rows.getColumn(0).getInt64()] = topics_.size();
      topics_.push_back(std::move(topic));
    }
    messages_.resize(topics_.size());
  }

  // In the order of the table, whose index may be damaged.
  void ReadMessages(const TopicFilter& wanted) {
    std::vector<bool> is_wanted;
    for (const MessageTopic& topic : topics_) is_wanted.push_back(wanted(topic));
    SQLite::Statement rows(*database_, "SELECT id, topic_id, timestamp FROM messages NOT INDEXED");
    std::size_t kept = 0, left_out = 0;
    while (rows.executeStep()) {
      ThrowIfGivenUp(path_);
      const auto found = by_id_.find(rows.getColumn(1).getInt64());
      if (found == by_id_.end()) continue;
      const StampNs log_ns = rows.getColumn(2).getInt64();
      constexpr StampNs kMostNs = std::numeric_limits<StampNs>::max() / 2;
      if (log_ns > kMostNs || log_ns < -kMostNs) continue;
      MessageTopic& topic = topics_[found->second];
      topic.first_log_ns = topic.messages == 0 ? log_ns : std::min(topic.first_log_ns, log_ns);
      topic.last_log_ns = topic.messages == 0 ? log_ns : std::max(topic.last_log_ns, log_ns);
      topic.log_times_known = true;
      ++topic.messages;
      if (!is_wanted[found->second]) continue;
      if (kept >= kMostMessages) {
        ++left_out;
        continue;
      }
      ++kept;
      messages_[found->second].push_back(
          {log_ns, static_cast<std::uint64_t>(rows.getColumn(0).getInt64()), 0, 0});
    }
    if (left_out > 0) {
      doubts_.push_back(
          fmt::format("{}: the last {} messages are left out, no more than {} are "
                      "read",
                      path_, left_out, kMostMessages));
    }
  }

  // Of a message, or the first `most`.
  ByteBuffer Bytes(const MessagePlace& place, std::size_t most) const {
    const std::string name = fmt::format("{}: message {}", path_, place.offset);
    ByteBuffer data = ReadBlob(name, static_cast<std::int64_t>(place.offset), most);
    if (!IsZstd(data.view())) {
      data.Shorten(std::min(data.size(), most));
      return data;
    }
    if (most < kFirstBytes) {
      data = ReadBlob(name, static_cast<std::int64_t>(place.offset), SIZE_MAX);
    }
    ByteBuffer unpacked =
        UnpackZstd(name, data.view(),
                   static_cast<std::size_t>(std::min<std::uint64_t>(most, kMostMessageBytes + 1)));
    if (unpacked.size() > kMostMessageBytes) throw InputError(name + ": is too long");
    return unpacked;
  }

  // Straight into the result: a column would hold a copy of its own.
  ByteBuffer ReadBlob(const std::string& name, std::int64_t row, std::size_t most) const {
    const std::lock_guard<std::mutex> lock(mutex_);
    sqlite3_blob* blob = nullptr;
    const auto fail = [&] {
      const std::string why = sqlite3_errmsg(database_->getHandle());
      sqlite3_blob_close(blob);
      throw InputError(fmt::format("{}: cannot be read: {}", name, why));
    };
    if (sqlite3_blob_open(database_->getHandle(), "main", "messages", "data", row, 0, &blob) !=
        SQLITE_OK) {
      fail();
    }
    const auto bytes = static_cast<std::size_t>(sqlite3_blob_bytes(blob));
    ByteBuffer data(std::min(bytes, most < kFirstBytes ? kFirstBytes : most));
    if (sqlite3_blob_read(blob, data.data(), static_cast<int>(data.size()), 0) != SQLITE_OK) fail();
    sqlite3_blob_close(blob);
    return data;
  }

  const std::string path_;
  // One statement runs at a time.
  mutable std::mutex mutex_;
  std::unique_ptr<SQLite::Database> database_;
  std::map<std::int64_t, std::size_t> by_id_;
};

}  // namespace

std::unique_ptr<MessageContainer> OpenRosbag2Database(const std::string& path,
                                                      const TopicFilter& wanted) {
  return std::make_unique<Rosbag2Database>(path, wanted);
}

}  // namespace lamina
