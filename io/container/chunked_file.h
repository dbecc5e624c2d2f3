// What ROS 1 bags and MCAP files have in common: messages in chunks of a file, compressed or not,
// of connections (channels) that belong to topics.
//
// Private to io/container.
#pragma once

#include <deque>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "io/container/byte_stream.h"
#include "io/container/chunk_cache.h"
#include "io/container/message_container.h"
#include "io/container/packed_stream.h"

namespace lamina {

class ChunkedFile : public MessageContainer {
 public:
  ChunkedFile(const std::string& path, const TopicFilter& wanted, std::shared_ptr<ChunkCache> cache)
      : file_(path), wanted_(wanted), cache_(std::move(cache)), file_number_(cache_->NextFile()) {}

  const std::vector<MessageTopic>& topics() const override { return topics_; }
  const std::vector<std::string>& doubts() const override { return doubts_; }
  const std::vector<MessagePlace>& Messages(std::size_t topic) const override {
    return messages_.at(topic);
  }
  std::string Read(const MessagePlace& place, std::size_t most) const override;

 protected:
  struct Chunk {
    std::uint64_t begin = 0, end = 0;  // of its data in the file
    std::uint64_t bytes = 0;           // unpacked
    Compression compression = Compression::kNone;
    std::uint32_t crc = 0;  // of what is unpacked; 0: not known
  };

  // The part of the data that is a message: `stream` stands at its record. At most `most` bytes.
  virtual std::string ReadRecord(ByteStream* stream, std::size_t most) const = 0;

  const RandomFile& file() const { return file_; }
  void Doubt(std::string text) { doubts_.push_back(std::move(text)); }
  // Why the file was read through, and what stopped that or was passed over: one line of doubts.
  void NoIndex(const std::string& why) { read_through_ = why + "; it was read through"; }
  void EndedBy(const std::string& what) { ended_by_ = what; }
  void Damaged(const std::string& what) {
    if (damaged_++ == 0) first_damage_ = what;
  }
  // Throws InputError with the place in the file.
  [[noreturn]] void Fail(std::uint64_t at, const std::string& what) const;

  // Forgets all, to begin again without an index.
  void Clear();
  // The topic of a connection that was added; null if there is none.
  struct Connection {
    std::size_t topic = 0;
    bool wanted = false;
  };
  const Connection* Find(std::uint64_t connection) const;
  // Added twice, it must be the same. Connections of one name and type are one topic.
  void AddConnection(std::uint64_t connection, MessageTopic topic);
  void Count(const Connection& connection, std::uint64_t messages) {
    topics_[connection.topic].messages += messages;
  }
  bool AnyWanted() const;
  // Checks what is said of a chunk.
  void CheckChunk(const Chunk& chunk, std::uint64_t at) const;
  std::uint32_t AddChunk(const Chunk& chunk);
  // Drops the last one, of which no message is wanted.
  void DropChunk() { chunks_.pop_back(); }
  void AddMessage(const Connection& connection, StampNs log_ns, std::uint32_t chunk,
                  std::uint64_t offset);
  // After the last of them: puts messages into order.
  void Finish();

  // Runs `use` on the chunk's unpacked bytes as they come, after their sum was checked if it fits
  // the cache.
  void WithChunk(std::uint32_t chunk, const std::function<void(ByteStream*)>& use) const;

 private:
  std::string Unpack(const Chunk& chunk) const;
  void CheckSum(const Chunk& chunk) const;
  std::unique_ptr<ByteStream> Stream(const Chunk& chunk) const;

  RandomFile file_;
  const TopicFilter wanted_;
  const std::shared_ptr<ChunkCache> cache_;
  const std::uint32_t file_number_;
  std::vector<MessageTopic> topics_;
  std::map<std::uint64_t, Connection> connections_;
  std::vector<std::vector<MessagePlace>> messages_;
  std::size_t all_messages_ = 0, left_out_ = 0;
  std::deque<Chunk> chunks_;
  std::vector<std::string> doubts_;
  std::string read_through_, ended_by_, first_damage_;
  std::size_t damaged_ = 0;
  // Places of those too large for the cache whose sum was found right.
  mutable std::mutex summed_mutex_;
  mutable std::set<std::uint64_t> summed_;
};

// The log time of a record, which must fit int64.
std::optional<StampNs> LogTime(std::uint64_t ns);

std::unique_ptr<MessageContainer> OpenRos1Bag(const std::string& path, const TopicFilter& wanted,
                                              const std::shared_ptr<ChunkCache>& cache);
std::unique_ptr<MessageContainer> OpenMcap(const std::string& path, const TopicFilter& wanted,
                                           const std::shared_ptr<ChunkCache>& cache);

}  // namespace lamina
