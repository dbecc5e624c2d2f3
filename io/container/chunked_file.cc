#include "io/container/chunked_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <tuple>

#include "core/base/error.h"
#include "io/file/checksum.h"

namespace lamina {
namespace {

// Larger chunks are unpacked anew for each message, piece by piece.
constexpr std::uint64_t kMostCachedBytes = 16 << 20;
// No recording is packed so well: such a chunk is made to take time and memory.
constexpr std::uint64_t kMostChunkRatio = 1000;
// Chunks that are packed to more are read piece by piece.
constexpr std::uint64_t kMostPackedBytes = 4 << 20;
constexpr std::size_t kPiece = 1 << 20;

}  // namespace

std::optional<StampNs> LogTime(std::uint64_t ns) {
  if (ns > static_cast<std::uint64_t>(std::numeric_limits<StampNs>::max() / 2)) return std::nullopt;
  return static_cast<StampNs>(ns);
}

void ChunkedFile::Fail(std::uint64_t at, const std::string& what) const {
  throw InputError(fmt::format("{}: byte {}: {}", file_.path(), at, what));
}

void ChunkedFile::Clear() {
  topics_.clear();
  connections_.clear();
  messages_.clear();
  all_messages_ = left_out_ = 0;
  chunks_.clear();
  doubts_.clear();
}

const ChunkedFile::Connection* ChunkedFile::Find(std::uint64_t connection) const {
  const auto found = connections_.find(connection);
  return found == connections_.end() ? nullptr : &found->second;
}

void ChunkedFile::AddConnection(std::uint64_t connection, MessageTopic topic) {
  if (const Connection* known = Find(connection)) {
    if (SameTopic(topics_[known->topic], topic)) return;
    throw InputError(fmt::format("{}: connection {} is of two topics, {} and {}", file_.path(),
                                 connection, topics_[known->topic].name, topic.name));
  }
  constexpr std::size_t kMostNameBytes = 1024;
  if (topic.name.size() > kMostNameBytes || topic.type.size() > kMostNameBytes) {
    throw InputError(fmt::format("{}: the name of a topic has {} bytes", file_.path(),
                                 std::max(topic.name.size(), topic.type.size())));
  }
  if (connections_.size() >= kMostTopics) {
    throw InputError(
        fmt::format("{}: more than {} connections: not read", file_.path(), kMostTopics));
  }
  const std::size_t at = PlaceOf(topic);
  if (at == topics_.size()) {
    topics_.push_back(std::move(topic));
    messages_.emplace_back();
  }
  connections_[connection] = {at, wanted_(topics_[at])};
}

void ChunkedFile::CheckChunk(const Chunk& chunk, std::uint64_t at) const {
  if (chunk.end > file_.size() || chunk.begin > chunk.end) {
    Fail(at, fmt::format("a chunk of {} bytes goes beyond the end of the file",
                         chunk.end - chunk.begin));
  }
  const bool plain = chunk.compression == Compression::kNone;
  const std::uint64_t packed = chunk.end - chunk.begin;
  if (plain ? chunk.bytes != packed
            : chunk.bytes > kMostCachedBytes && chunk.bytes / kMostChunkRatio > packed) {
    Fail(at, fmt::format("a chunk of {} bytes cannot have {} when unpacked", packed, chunk.bytes));
  }
}

std::uint32_t ChunkedFile::AddChunk(const Chunk& chunk) {
  chunks_.push_back(chunk);
  return static_cast<std::uint32_t>(chunks_.size() - 1);
}

void ChunkedFile::AddMessage(const Connection& connection, StampNs log_ns, std::uint32_t chunk,
                             std::uint64_t offset) {
  MessageTopic& topic = topics_[connection.topic];
  topic.first_log_ns = topic.log_times_known ? std::min(topic.first_log_ns, log_ns) : log_ns;
  topic.last_log_ns = topic.log_times_known ? std::max(topic.last_log_ns, log_ns) : log_ns;
  topic.log_times_known = true;
  if (!connection.wanted) return;
  if (all_messages_ >= kMostMessages) {
    ++left_out_;
    return;
  }
  ++all_messages_;
  messages_[connection.topic].push_back({log_ns, offset, chunk, 0});
}

void ChunkedFile::Finish() {
  const auto earlier = [](const MessagePlace& a, const MessagePlace& b) {
    return a.log_ns < b.log_ns;
  };
  for (std::vector<MessagePlace>& places : messages_) {
    if (!std::is_sorted(places.begin(), places.end(), earlier)) {
      // By their places as well: the order of the index need not be that of the file.
      std::sort(places.begin(), places.end(), [](const MessagePlace& a, const MessagePlace& b) {
        return std::tie(a.log_ns, a.chunk, a.offset) < std::tie(b.log_ns, b.chunk, b.offset);
      });
    }
  }
  if (!read_through_.empty()) {
    std::string text = file_.path() + ": " + read_through_;
    if (!ended_by_.empty()) text += " as far as it goes: " + ended_by_;
    if (damaged_ > 0) {
      text += fmt::format("; {} chunks are damaged, at least in part: {}", damaged_, first_damage_);
    }
    doubts_.push_back(std::move(text));
  }
  if (left_out_ > 0) {
    doubts_.push_back(fmt::format("{}: the last {} messages are left out, no more than {} are read",
                                  file_.path(), left_out_, kMostMessages));
  }
}

void ChunkedFile::WalkFile(const std::string& why, FileStream* stream, std::uint64_t bytes,
                           const std::function<bool()>& read_record) {
  read_through_ = why + "; it was read through";
  try {
    while (stream->position() < bytes && read_record()) {
    }
  } catch (const InputError& error) {
    ended_by_ = error.what();
  }
}

void ChunkedFile::WalkChunk(
    const std::function<Chunk()>& read_head,
    const std::function<bool(ByteStream*, std::uint32_t chunk)>& read_record) {
  try {
    const Chunk chunk = read_head();
    const std::uint32_t number = AddChunk(chunk);
    bool any = false;
    WithChunk(number, [&](ByteStream* stream) {
      while (stream->position() < chunk.bytes) any = read_record(stream, number) || any;
    });
    if (!any) DropChunk();
  } catch (const InputError& error) {
    if (damaged_++ == 0) first_damage_ = error.what();
  }
}

std::string ChunkedFile::NameOf(const Chunk& chunk) const {
  return fmt::format("{}: chunk at byte {}", file_.path(), chunk.begin);
}

std::unique_ptr<ByteStream> ChunkedFile::Stream(const Chunk& chunk) const {
  if (chunk.compression == Compression::kNone) {
    return std::make_unique<FileStream>(file_, chunk.begin, chunk.end);
  }
  return std::make_unique<PackedStream>(NameOf(chunk), chunk.compression,
                                        SourceOf(file_, chunk.begin, chunk.end));
}

ByteBuffer ChunkedFile::Unpack(const Chunk& chunk) const {
  ByteBuffer bytes = cache_->spare().Take(static_cast<std::size_t>(chunk.bytes));
  const std::uint64_t packed = chunk.end - chunk.begin;
  if (chunk.compression == Compression::kNone || packed > kMostPackedBytes) {
    Stream(chunk)->Read(bytes.data(), bytes.size());
  } else {
    // All at once: decoders then write to where the bytes are wanted, and nowhere before.
    ByteBuffer in = cache_->spare().Take(static_cast<std::size_t>(packed));
    FileStream(file_, chunk.begin, chunk.end).Read(in.data(), in.size());
    PackedStream(NameOf(chunk), chunk.compression, in.view()).Read(bytes.data(), bytes.size());
    cache_->spare().Give(std::move(in));
  }
  if (chunk.crc != 0 && Crc32(bytes.view()) != chunk.crc) {
    Fail(chunk.begin, "this chunk is damaged: its checksum is another");
  }
  return bytes;
}

void ChunkedFile::CheckSum(const Chunk& chunk) const {
  {
    const std::lock_guard<std::mutex> lock(summed_mutex_);
    if (summed_.count(chunk.begin) > 0) return;
  }
  const auto stream = Stream(chunk);
  std::uint32_t sum = 0;
  while (stream->position() < chunk.bytes) {
    const std::uint64_t piece = std::min<std::uint64_t>(kPiece, chunk.bytes - stream->position());
    sum = Crc32(stream->Text(piece, piece), sum);
  }
  if (sum != chunk.crc) Fail(chunk.begin, "this chunk is damaged: its checksum is another");
  const std::lock_guard<std::mutex> lock(summed_mutex_);
  summed_.insert(chunk.begin);
}

void ChunkedFile::WithChunk(std::uint32_t number,
                            const std::function<void(ByteStream*)>& use) const {
  const Chunk& chunk = chunks_.at(number);
  const bool plain = chunk.compression == Compression::kNone;
  if (chunk.bytes <= kMostCachedBytes && (!plain || chunk.crc != 0)) {
    cache_->With(
        {file_number_, chunk.begin}, static_cast<std::size_t>(chunk.bytes),
        [&] { return Unpack(chunk); },
        [&](std::string_view bytes) {
          MemoryStream stream(NameOf(chunk), bytes);
          use(&stream);
        });
    return;
  }
  if (chunk.crc != 0) CheckSum(chunk);
  use(Stream(chunk).get());
}

std::string ChunkedFile::Read(const MessagePlace& place, std::size_t most) const {
  std::string copy;
  WithRecord(place, most, [&](std::string_view bytes) { copy = bytes; });
  return copy;
}

void ChunkedFile::With(const MessagePlace& place,
                       const std::function<void(std::string_view)>& use) const {
  WithRecord(place, SIZE_MAX, use);
}

void ChunkedFile::WithRecord(const MessagePlace& place, std::size_t most,
                             const std::function<void(std::string_view)>& use) const {
  WithChunk(place.chunk, [&](ByteStream* stream) {
    stream->Skip(place.offset);
    ByteBuffer room = cache_->spare().Take(0);
    use(ReadRecord(stream, most, &room));
    cache_->spare().Give(std::move(room));
  });
}

}  // namespace lamina
