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

#include "io/container/message_table.h"
#include "io/stream/byte_stream.h"
#include "io/stream/chunk_cache.h"
#include "io/stream/packed_stream.h"

namespace lamina {

class ChunkedFile : public MessageTable {
 public:
  ChunkedFile(std::string kind, const std::string& path, const TopicFilter& wanted,
              std::shared_ptr<ChunkCache> cache)
      : MessageTable(std::move(kind)),
        file_(path),
        wanted_(wanted),
        cache_(std::move(cache)),
        file_number_(cache_->NextFile()) {}

  std::string Read(const MessagePlace& place, std::size_t most) const override;
  void With(const MessagePlace& place,
            const std::function<void(std::string_view)>& use) const override;

 protected:
  struct Chunk {
    std::uint64_t begin = 0, end = 0;  // of its data in the file
    std::uint64_t bytes = 0;           // unpacked
    Compression compression = Compression::kNone;
    std::uint32_t crc = 0;  // of what is unpacked; 0: not known
  };

  // The part of the data that is a message: `stream` stands at its record. At most `most` bytes,
  // where they lie or in `room`.
  virtual std::string_view ReadRecord(ByteStream* stream, std::size_t most,
                                      ByteBuffer* room) const = 0;

  const RandomFile& file() const { return file_; }
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
  // Checks what is said of a chunk.
  void CheckChunk(const Chunk& chunk, std::uint64_t at) const;
  std::uint32_t AddChunk(const Chunk& chunk);
  // Drops the last one, of which no message is wanted.
  void DropChunk() { chunks_.pop_back(); }
  void AddMessage(const Connection& connection, StampNs log_ns, std::uint32_t chunk,
                  std::uint64_t offset);
  // After the last of them: puts messages into order.
  void Finish();

  // The way of a file without a usable index, told in one line of doubts: why it is read through,
  // what ended that, and how many chunks are damaged. `read_record` reads one record off `stream`,
  // which ends at the file's end; it returns false if that was the last.
  void WalkFile(const std::string& why, FileStream* stream, std::uint64_t bytes,
                const std::function<bool()>& read_record);
  // Adds a chunk, and what `read_record` finds in it: true for a message that is wanted, without
  // any of which the chunk is dropped. What is wrong with the chunk, or with what `read_head` says
  // of it, is counted as damage.
  void WalkChunk(const std::function<Chunk()>& read_head,
                 const std::function<bool(ByteStream*, std::uint32_t chunk)>& read_record);

 private:
  // Runs `use` on the chunk's unpacked bytes as they come, after their sum was checked if it fits
  // the cache.
  void WithChunk(std::uint32_t chunk, const std::function<void(ByteStream*)>& use) const;
  ByteBuffer Unpack(const Chunk& chunk) const;
  void CheckSum(const Chunk& chunk) const;
  std::string NameOf(const Chunk& chunk) const;
  void WithRecord(const MessagePlace& place, std::size_t most,
                  const std::function<void(std::string_view)>& use) const;
  std::unique_ptr<ByteStream> Stream(const Chunk& chunk) const;

  RandomFile file_;
  const TopicFilter wanted_;
  const std::shared_ptr<ChunkCache> cache_;
  const std::uint32_t file_number_;
  std::map<std::uint64_t, Connection> connections_;
  std::size_t all_messages_ = 0, left_out_ = 0;
  std::deque<Chunk> chunks_;
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
