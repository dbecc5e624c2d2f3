// ROS 1 bags, version 2.0 (http://wiki.ros.org/Bags/Format/2.0):
//
//   "#ROSBAG V2.0\n", then records: length and fields of a header (`name=value` behind its length),
//   length and data. First the bag header (op 3, which tells where the index is), then chunks (op
//   5, whose data are records of connections, op 7, and messages, op 2), each with its indices (op
//   4, the messages of one connection), last connections and the places of the chunks (op 6).
//
// A recorder that dies leaves index_pos = 0 and the last chunk unfinished.
#include <fmt/format.h>

#include <map>

#include "core/base/error.h"
#include "io/container/chunked_file.h"

namespace lamina {
namespace {

constexpr char kBagMagic[] = "#ROSBAG V2.0\n";
constexpr std::size_t kBagMagicBytes = sizeof(kBagMagic) - 1;
constexpr std::uint64_t kNsPerS = 1'000'000'000;
constexpr std::uint64_t kMostHeaderBytes = 1 << 16;
constexpr std::uint64_t kMostDefinitionBytes = 16 << 20;

enum Op : unsigned char {
  kMessageOp = 2,
  kBagHeaderOp = 3,
  kIndexOp = 4,
  kChunkOp = 5,
  kChunkInfoOp = 6,
  kConnectionOp = 7
};

// `name=value` pairs, each behind its length.
class Fields {
 public:
  Fields(const std::string& bytes, const ByteStream& stream) : stream_(stream) {
    std::size_t at = 0;
    while (at < bytes.size()) {
      std::uint32_t length = 0;
      if (bytes.size() - at < sizeof(length)) stream.Fail("a field of a header has no length");
      std::memcpy(&length, bytes.data() + at, sizeof(length));
      at += sizeof(length);
      const std::string field = length <= bytes.size() - at ? bytes.substr(at, length) : "";
      const std::size_t equals = field.find('=');
      if (equals == std::string::npos) stream.Fail("a field of a header is not name=value");
      values_[field.substr(0, equals)] = field.substr(equals + 1);
      at += length;
    }
  }

  const std::string& Text(const std::string& name) const {
    const auto found = values_.find(name);
    if (found == values_.end()) stream_.Fail(fmt::format("a header has no field '{}'", name));
    return found->second;
  }

  template <typename T>
  T Number(const std::string& name) const {
    const std::string& text = Text(name);
    if (text.size() != sizeof(T)) {
      stream_.Fail(fmt::format("field '{}' of a header has {} bytes, must have {}", name,
                               text.size(), sizeof(T)));
    }
    T value;
    std::memcpy(&value, text.data(), sizeof(T));
    return value;
  }

  unsigned char op() const { return Number<unsigned char>("op"); }

 private:
  const ByteStream& stream_;
  std::map<std::string, std::string> values_;
};

// A record whose header is read, and its data not yet.
struct Record {
  Fields fields;
  std::uint32_t data_bytes = 0;
};

Record ReadBagRecord(ByteStream* stream) {
  const std::string header = stream->Text(stream->Number<std::uint32_t>(), kMostHeaderBytes);
  Record record{Fields(header, *stream), 0};
  record.data_bytes = stream->Number<std::uint32_t>();
  return record;
}

std::optional<StampNs> TimeOf(std::uint64_t sec_nsec) {
  return LogTime((sec_nsec & 0xFFFFFFFFU) * kNsPerS + (sec_nsec >> 32U));
}

class Ros1Bag final : public ChunkedFile {
 public:
  Ros1Bag(const std::string& path, const TopicFilter& wanted, std::shared_ptr<ChunkCache> cache)
      : ChunkedFile("a ROS 1 bag", path, wanted, std::move(cache)) {
    FileStream stream(file(), 0, file().size());
    if (stream.Text(kBagMagicBytes, kBagMagicBytes) != kBagMagic) {
      stream.Fail("a ROS 1 bag of another version than 2.0; `rosbag migrate` brings it there");
    }
    const Record header = ReadBagRecord(&stream);
    if (header.fields.op() != kBagHeaderOp) stream.Fail("the bag's header is missing");
    const auto index = header.fields.Number<std::uint64_t>("index_pos");
    const auto chunks = header.fields.Number<std::uint32_t>("chunk_count");
    stream.Skip(header.data_bytes);
    const std::uint64_t first_chunk = stream.position();
    if (index == 0) {
      Walk("was not closed by its recorder and has no index", first_chunk);
    } else {
      try {
        ReadIndex(index, chunks);
      } catch (const InputError& error) {
        Clear();
        Walk(fmt::format("the index cannot be used ({})", error.what()), first_chunk);
      }
    }
    Finish();
  }

 private:
  void ReadIndex(std::uint64_t index, std::uint32_t chunk_count) {
    FileStream stream(file(), index, file().size(), 1 << 16);
    std::vector<std::uint64_t> places;
    while (index + stream.position() < file().size()) {
      const Record record = ReadBagRecord(&stream);
      if (record.fields.op() == kConnectionOp) {
        ReadConnection(record, &stream);
        continue;
      }
      if (record.fields.op() == kChunkInfoOp) {
        // Chunks are counted by what the file has bytes for.
        places.push_back(record.fields.Number<std::uint64_t>("chunk_pos"));
      }
      stream.Skip(record.data_bytes);
    }
    if (places.size() != chunk_count) {
      stream.Fail(fmt::format("it has {} chunks, {} are announced", places.size(), chunk_count));
    }
    for (const std::uint64_t place : places) ReadChunkIndex(place, index);
  }

  Chunk ReadChunkHeader(const Record& record, std::uint64_t data, const ByteStream& stream) const {
    const auto compression = CompressionByName(record.fields.Text("compression"));
    if (!compression) stream.Fail("a chunk's compression is none of none, bz2 and lz4");
    Chunk chunk;
    chunk.begin = data;
    chunk.end = data + record.data_bytes;
    chunk.bytes = record.fields.Number<std::uint32_t>("size");
    chunk.compression = *compression;
    CheckChunk(chunk, data);
    return chunk;
  }

  // The indices of connections stand behind the chunk.
  void ReadChunkIndex(std::uint64_t place, std::uint64_t end) {
    FileStream stream(file(), place, end, 512);
    const Record head = ReadBagRecord(&stream);
    if (head.fields.op() != kChunkOp) stream.Fail("there is no chunk where the index says");
    const Chunk chunk = ReadChunkHeader(head, place + stream.position(), stream);
    stream.Skip(head.data_bytes);
    const std::uint32_t number = AddChunk(chunk);
    bool any = false;
    while (place + stream.position() < end) {
      const Record record = ReadBagRecord(&stream);
      if (record.fields.op() != kIndexOp) break;
      const auto count = record.fields.Number<std::uint32_t>("count");
      const Connection* connection = Find(record.fields.Number<std::uint32_t>("conn"));
      constexpr std::uint64_t kEntryBytes = 12;
      if (connection == nullptr || count * kEntryBytes != record.data_bytes) {
        stream.Fail("the index of a chunk contradicts itself");
      }
      Count(*connection, count);
      if (!connection->wanted) {
        stream.Skip(record.data_bytes);
        continue;
      }
      any = true;
      for (std::uint32_t i = 0; i < count; ++i) {
        const auto log = TimeOf(stream.Number<std::uint64_t>());
        const auto offset = stream.Number<std::uint32_t>();
        if (!log || offset >= chunk.bytes) stream.Fail("the index of a chunk points beyond it");
        AddMessage(*connection, *log, number, offset);
      }
    }
    if (!any) DropChunk();
  }

  void ReadConnection(const Record& record, ByteStream* stream) {
    const auto connection = record.fields.Number<std::uint32_t>("conn");
    const Fields data(stream->Text(record.data_bytes, kMostDefinitionBytes), *stream);
    MessageTopic topic;
    topic.name = record.fields.Text("topic");
    topic.type = data.Text("type");
    topic.encoding = MessageEncoding::kRos1;
    AddConnection(connection, std::move(topic));
  }

  // Chunk by chunk, without the index.
  void Walk(const std::string& why, std::uint64_t first) {
    FileStream stream(file(), first, file().size());
    WalkFile(why, &stream, file().size() - first, [&] {
      const Record record = ReadBagRecord(&stream);
      if (record.fields.op() == kConnectionOp) {
        ReadConnection(record, &stream);
        return true;
      }
      if (record.fields.op() == kChunkOp) {
        WalkChunk([&] { return ReadChunkHeader(record, first + stream.position(), stream); },
                  [&](ByteStream* chunk, std::uint32_t number) {
                    return ReadChunkRecord(chunk, number);
                  });
      }
      stream.Skip(record.data_bytes);
      return true;
    });
  }

  // True for a message that is wanted.
  bool ReadChunkRecord(ByteStream* stream, std::uint32_t chunk) {
    const std::uint64_t offset = stream->position();
    const Record record = ReadBagRecord(stream);
    if (record.fields.op() == kConnectionOp) {
      ReadConnection(record, stream);
      return false;
    }
    if (record.fields.op() != kMessageOp) {
      stream->Skip(record.data_bytes);
      return false;
    }
    const Connection* connection = Find(record.fields.Number<std::uint32_t>("conn"));
    const auto log = TimeOf(record.fields.Number<std::uint64_t>("time"));
    if (connection == nullptr || !log) stream->Fail("a message is of no connection");
    stream->Skip(record.data_bytes);
    Count(*connection, 1);
    AddMessage(*connection, *log, chunk, offset);
    return connection->wanted;
  }

  std::string_view ReadRecord(ByteStream* stream, std::size_t most,
                              ByteBuffer* room) const override {
    const Record record = ReadBagRecord(stream);
    if (record.fields.op() != kMessageOp) stream->Fail("there is no message where the index says");
    if (record.data_bytes > kMostMessageBytes) stream->Fail("a message is too long");
    return stream->View(std::min<std::uint64_t>(record.data_bytes, most), kMostMessageBytes, room);
  }
};

}  // namespace

std::unique_ptr<MessageContainer> OpenRos1Bag(const std::string& path, const TopicFilter& wanted,
                                              const std::shared_ptr<ChunkCache>& cache) {
  return std::make_unique<Ros1Bag>(path, wanted, cache);
}

}  // namespace lamina
