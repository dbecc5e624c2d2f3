// MCAP files (https://mcap.dev/spec): magic, records (opcode, length, content), magic.
//
//   data     header, then schemas, channels, messages, each loose or in chunks; behind a chunk the
//            indices of its messages, one a channel
//   summary  schemas and channels again, the places of chunks and of their indices, statistics
//   footer   where the summary is, and its sum
//
// All but header and data may be missing. Sums of chunks and of the summary are checked; that of
// the whole data section, which most files leave at 0, is not.
#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <set>

#include "core/base/error.h"
#include "io/container/chunked_file.h"
#include "io/file/checksum.h"

namespace lamina {
namespace {

constexpr std::string_view kMcapMagic("\x89MCAP0\r\n", 8);
constexpr std::uint64_t kRecordHead = 9;  // opcode and length
constexpr std::uint64_t kFooterBytes = 20;
constexpr std::uint64_t kMessageHead = 22;  // channel, sequence, two times
constexpr std::uint64_t kChannelEntryBytes = sizeof(std::uint16_t) + sizeof(std::uint64_t);

enum Opcode : unsigned char {
  kHeader = 0x01,
  kFooter = 0x02,
  kSchema = 0x03,
  kChannel = 0x04,
  kMessage = 0x05,
  kChunk = 0x06,
  kMessageIndex = 0x07,
  kChunkIndex = 0x08,
  kStatistics = 0x0B,
  kDataEnd = 0x0F
};

struct RecordHead {
  unsigned char opcode = 0;
  std::uint64_t bytes = 0;
};

RecordHead ReadRecordHead(ByteStream* stream) {
  RecordHead head;
  head.opcode = stream->Number<unsigned char>();
  head.bytes = stream->Number<std::uint64_t>();
  return head;
}

// The content of a record, which must not be passed.
class Content {
 public:
  Content(ByteStream* stream, std::uint64_t bytes)
      : stream_(stream), end_(stream->position() + bytes) {
    if (end_ < bytes) stream->Fail("a record of an impossible length");
  }
  ByteStream* operator->() const { return stream_; }
  std::uint64_t left() const {
    if (stream_->position() > end_) stream_->Fail("a record is shorter than what is in it");
    return end_ - stream_->position();
  }
  // Runs `read` for each entry of a list that stands behind its length in bytes.
  template <typename Read>
  void ForEachEntry(std::uint64_t entry_bytes, const Read& read) const {
    std::uint64_t list = stream_->Number<std::uint32_t>();
    if (list > left()) stream_->Fail("a record is shorter than what is in it");
    for (; list >= entry_bytes; list -= entry_bytes) read();
    stream_->Skip(list);
  }
  // Further fields may be there, of later versions.
  void SkipRest() const { stream_->Skip(left()); }

 private:
  ByteStream* stream_;
  std::uint64_t end_;
};

class Mcap final : public ChunkedFile {
 public:
  Mcap(const std::string& path, const TopicFilter& wanted, std::shared_ptr<ChunkCache> cache)
      : ChunkedFile("an MCAP file", path, wanted, std::move(cache)) {
    std::string why = "has no index";
    bool indexed = false;
    try {
      indexed = ReadSummary();
    } catch (const InputError& error) {
      why = fmt::format("the index cannot be used ({})", error.what());
    }
    if (!indexed) {
      Clear();
      schemas_.clear();
      chunk_indices_.clear();
      Walk(why);
    }
    chunk_indices_ = {};
    Finish();
  }

 private:
  struct ChunkIndex {
    std::uint64_t place = 0;
    std::map<std::uint16_t, std::uint64_t> message_indices;  // by channel, wanted ones alone
    std::uint64_t index_bytes = 0;
  };
  struct Statistics {
    std::uint64_t messages = 0;
    std::uint32_t chunks = 0;
    std::map<std::uint16_t, std::uint64_t> of_channel;
  };

  // False if there is none that names all messages.
  bool ReadSummary() {
    const std::uint64_t tail = kRecordHead + kFooterBytes + kMcapMagic.size();
    if (file().size() < kMcapMagic.size() + tail) return false;
    const std::uint64_t footer = file().size() - tail;
    FileStream stream(file(), footer, file().size());
    const RecordHead head = ReadRecordHead(&stream);
    if (head.opcode != kFooter || head.bytes != kFooterBytes) return false;
    const auto begin = stream.Number<std::uint64_t>();
    stream.Skip(sizeof(std::uint64_t));
    const auto sum = stream.Number<std::uint32_t>();
    if (stream.Text(kMcapMagic.size(), kMcapMagic.size()) != kMcapMagic) return false;
    if (begin == 0) return false;
    if (begin > footer) stream.Fail("the summary begins behind its end");
    if (sum != 0) CheckSummary(begin, footer + kRecordHead + 2 * sizeof(std::uint64_t), sum);
    std::optional<Statistics> statistics;
    FileStream summary(file(), begin, footer, 1 << 16);
    // Channels first: what chunks hold of others is passed over.
    while (begin + summary.position() < footer) {
      const RecordHead record = ReadRecordHead(&summary);
      const Content content(&summary, record.bytes);
      if (record.opcode == kSchema) ReadSchema(content);
      if (record.opcode == kChannel) ReadChannel(content);
      if (record.opcode == kChunkIndex) ReadChunkIndex(content);
      if (record.opcode == kStatistics) statistics = ReadStatistics(content);
      content.SkipRest();
    }
    return statistics.has_value() && UseSummary(*statistics);
  }

  void CheckSummary(std::uint64_t begin, std::uint64_t end, std::uint32_t expected) const {
    char piece[1 << 14];
    std::uint32_t sum = 0;
    while (begin < end) {
      const std::size_t got = file().ReadAt(
          begin, piece,
          static_cast<std::size_t>(std::min<std::uint64_t>(end - begin, sizeof(piece))));
      if (got == 0) break;
      sum = Crc32({piece, got}, sum);
      begin += got;
    }
    if (sum != expected) Fail(end, "the checksum of the summary is another");
  }

  bool UseSummary(const Statistics& statistics) {
    if (chunk_indices_.size() != statistics.chunks) return false;
    std::uint64_t of_channels = 0;
    for (const auto& [channel, messages] : statistics.of_channel) {
      const Connection* connection = Find(channel);
      if (connection == nullptr) return false;
      Count(*connection, messages);
      of_channels += messages;
    }
    if (of_channels != statistics.messages) return false;
    std::uint64_t expected = 0, found = 0;
    for (const auto& [channel, messages] : statistics.of_channel) {
      if (Find(channel)->wanted) expected += messages;
    }
    for (const ChunkIndex& index : chunk_indices_) found += ReadMessageIndices(index);
    return found == expected;
  }

  void ReadSchema(const Content& content) {
    const auto id = content->Number<std::uint16_t>();
    schemas_[id] = Ros1TypeName(content->ShortText());
    content.left();
  }

  void ReadChannel(const Content& content) {
    const auto id = content->Number<std::uint16_t>();
    const auto schema = schemas_.find(content->Number<std::uint16_t>());
    MessageTopic topic;
    topic.name = content->ShortText();
    const std::string encoding = content->ShortText();
    content.left();
    if (schema != schemas_.end()) topic.type = schema->second;
    if (encoding == "ros1") topic.encoding = MessageEncoding::kRos1;
    if (encoding == "cdr") topic.encoding = MessageEncoding::kCdr;
    cdr_ = cdr_ || encoding == "cdr";
    AddConnection(id, std::move(topic));
  }

  void ReadChunkIndex(const Content& content) {
    ChunkIndex index;
    content->Skip(2 * sizeof(std::uint64_t));
    index.place = content->Number<std::uint64_t>();
    content->Skip(sizeof(std::uint64_t));
    content.ForEachEntry(kChannelEntryBytes, [&] {
      const auto channel = content->Number<std::uint16_t>();
      const auto place = content->Number<std::uint64_t>();
      const Connection* connection = Find(channel);
      if (connection == nullptr) content->Fail("a chunk has messages of an unknown channel");
      if (connection->wanted) index.message_indices[channel] = place;
    });
    if (chunk_indices_.size() >= kMostMessages) content->Fail("too many chunks");
    chunk_indices_.push_back(std::move(index));
  }

  static Statistics ReadStatistics(const Content& content) {
    Statistics statistics;
    statistics.messages = content->Number<std::uint64_t>();
    content->Skip(sizeof(std::uint16_t) + 3 * sizeof(std::uint32_t));
    statistics.chunks = content->Number<std::uint32_t>();
    content->Skip(2 * sizeof(std::uint64_t));
    content.ForEachEntry(kChannelEntryBytes, [&] {
      const auto channel = content->Number<std::uint16_t>();
      statistics.of_channel[channel] = content->Number<std::uint64_t>();
    });
    return statistics;
  }

  // Those of the wanted channels; how many messages they name.
  std::uint64_t ReadMessageIndices(const ChunkIndex& index) {
    if (index.message_indices.empty()) return 0;
    FileStream head(file(), index.place, file().size(), 128);
    const RecordHead record = ReadRecordHead(&head);
    if (record.opcode != kChunk) head.Fail("there is no chunk where the index says");
    const Chunk chunk = ReadChunkHead(Content(&head, record.bytes), index.place);
    const std::uint32_t number = AddChunk(chunk);
    std::uint64_t found = 0;
    for (const auto& [channel, place] : index.message_indices) {
      FileStream stream(file(), place, file().size(), 512);
      const RecordHead entries = ReadRecordHead(&stream);
      if (entries.opcode != kMessageIndex) stream.Fail("there is no index where one should be");
      const Content content(&stream, entries.bytes);
      if (content->Number<std::uint16_t>() != channel) stream.Fail("an index of another channel");
      content.ForEachEntry(2 * sizeof(std::uint64_t), [&, of = channel] {
        const auto log = LogTime(stream.Number<std::uint64_t>());
        const auto offset = stream.Number<std::uint64_t>();
        if (!log || offset >= chunk.bytes) stream.Fail("the index of a chunk points beyond it");
        AddMessage(*Find(of), *log, number, offset);
        ++found;
      });
    }
    return found;
  }

  // The stream stands at the content of a chunk's record, which is at `place` in the file; then at
  // its data.
  Chunk ReadChunkHead(const Content& content, std::uint64_t place) const {
    const std::uint64_t begin = content->position();
    Chunk chunk;
    content->Skip(2 * sizeof(std::uint64_t));
    chunk.bytes = content->Number<std::uint64_t>();
    chunk.crc = content->Number<std::uint32_t>();
    const std::string name = content->ShortText();
    const auto compression = CompressionByName(name);
    if (!compression || *compression == Compression::kBz2) {
      content->Fail(fmt::format("compression '{}' is none of none, lz4 and zstd", name));
    }
    chunk.compression = *compression;
    const auto bytes = content->Number<std::uint64_t>();
    if (bytes > content.left()) content->Fail("a chunk is shorter than what is in it");
    chunk.begin = place + kRecordHead + (content->position() - begin);
    chunk.end = chunk.begin + bytes;
    CheckChunk(chunk, place);
    return chunk;
  }

  void Walk(const std::string& why) {
    // What is not in chunks is in one that is the whole file.
    Chunk whole;
    whole.end = whole.bytes = file().size();
    const std::uint32_t loose = AddChunk(whole);
    FileStream stream(file(), 0, file().size());
    stream.Skip(kMcapMagic.size());
    WalkFile(why, &stream, file().size(), [&] {
      const std::uint64_t place = stream.position();
      const RecordHead record = ReadRecordHead(&stream);
      if (record.opcode == kDataEnd || record.opcode == kFooter) return false;
      const Content content(&stream, record.bytes);
      if (content.left() > file().size() - stream.position()) stream.Fail("the file ends here");
      if (record.opcode == kChunk) {
        std::uint64_t bytes = 0;
        WalkChunk(
            [&] {
              const Chunk chunk = ReadChunkHead(content, place);
              bytes = chunk.bytes;
              return chunk;
            },
            [&](ByteStream* chunk, std::uint32_t number) {
              return ReadChunkRecord(chunk, bytes, number);
            });
      } else {
        ReadDataRecord(record.opcode, content, loose, place);
      }
      content.SkipRest();
      return true;
    });
  }

  // True for a message that is wanted.
  bool ReadChunkRecord(ByteStream* stream, std::uint64_t chunk_bytes, std::uint32_t chunk) {
    const std::uint64_t place = stream->position();
    const RecordHead record = ReadRecordHead(stream);
    const Content content(stream, record.bytes);
    if (content.left() > chunk_bytes - stream->position()) stream->Fail("the chunk ends here");
    const bool wanted = ReadDataRecord(record.opcode, content, chunk, place);
    content.SkipRest();
    return wanted;
  }

  // True for a message that is wanted.
  bool ReadDataRecord(unsigned char opcode, const Content& content, std::uint32_t chunk,
                      std::uint64_t place) {
    if (opcode == kSchema) ReadSchema(content);
    if (opcode == kChannel) ReadChannel(content);
    if (opcode != kMessage) return false;
    const Connection* connection = Find(content->Number<std::uint16_t>());
    content->Skip(sizeof(std::uint32_t));
    const auto log = LogTime(content->Number<std::uint64_t>());
    if (connection == nullptr || !log) content->Fail("a message is of no channel");
    // Its end is within file or chunk: this was checked.
    Count(*connection, 1);
    AddMessage(*connection, *log, chunk, place);
    return connection->wanted;
  }

  std::string_view ReadRecord(ByteStream* stream, std::size_t most,
                              ByteBuffer* room) const override {
    const RecordHead record = ReadRecordHead(stream);
    if (record.opcode != kMessage || record.bytes < kMessageHead) {
      stream->Fail("there is no message where the index says");
    }
    stream->Skip(kMessageHead);
    const std::uint64_t bytes = record.bytes - kMessageHead;
    if (bytes > kMostMessageBytes) stream->Fail("a message is too long");
    // rosbag2 may have compressed messages one by one. No CDR begins as such a message does.
    constexpr std::uint64_t kMagicBytes = 4;
    const std::string_view data = stream->View(
        std::min(bytes, std::max<std::uint64_t>(most, kMagicBytes)), kMostMessageBytes, room);
    if (!cdr_ || !IsZstd(data)) return data.substr(0, most);
    std::string packed(data);
    packed += stream->Text(bytes - packed.size(), kMostMessageBytes);
    const std::string name = file().path() + ": a message";
    *room = UnpackZstd(name, packed, std::min<std::size_t>(most, kMostMessageBytes));
    return room->view();
  }

  std::map<std::uint16_t, std::string> schemas_;
  std::deque<ChunkIndex> chunk_indices_;
  bool cdr_ = false;  // some messages are
};

}  // namespace

std::unique_ptr<MessageContainer> OpenMcap(const std::string& path, const TopicFilter& wanted,
                                           const std::shared_ptr<ChunkCache>& cache) {
  return std::make_unique<Mcap>(path, wanted, cache);
}

}  // namespace lamina
