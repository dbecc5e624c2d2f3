// Bags and MCAP files for tests, written byte by byte so that no reader is checked by its own
// writer; and messages for them.
#pragma once

#include <SQLiteCpp/SQLiteCpp.h>
#include <bzlib.h>
#include <lz4frame.h>
#include <zlib.h>
#include <zstd.h>

#include <algorithm>
#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "core/geometry/scan.h"
#include "tests/support/files/io_test_files.h"

namespace lamina {

struct RecordedTopic {
  std::string name, type;  // as in ROS 1
};
struct RecordedMessage {
  std::size_t topic = 0;
  StampNs log_ns = 0;
  std::string bytes;
};
struct RecordedMessages {
  std::vector<RecordedTopic> topics;
  std::vector<RecordedMessage> messages;
};

inline std::string Compressed(const std::string& bytes, const std::string& how) {
  std::string out;
  if (how == "lz4" || how == "lz4 of ROS 1") {
    LZ4F_preferences_t how_packed = {};
    if (how != "lz4") {
      // It reads no other: blocks on their own, and a checksum.
      how_packed.frameInfo.blockMode = LZ4F_blockIndependent;
      how_packed.frameInfo.contentChecksumFlag = LZ4F_contentChecksumEnabled;
    }
    out.resize(LZ4F_compressFrameBound(bytes.size(), &how_packed));
    out.resize(LZ4F_compressFrame(out.data(), out.size(), bytes.data(), bytes.size(), &how_packed));
  } else if (how == "zstd") {
    out.resize(ZSTD_compressBound(bytes.size()));
    out.resize(ZSTD_compress(out.data(), out.size(), bytes.data(), bytes.size(), 3));
  } else if (how == "bz2") {
    auto size = static_cast<unsigned int>(bytes.size() + bytes.size() / 50 + 1000);
    out.resize(size);
    std::string in = bytes;
    BZ2_bzBuffToBuffCompress(out.data(), &size, in.data(), static_cast<unsigned int>(in.size()), 9,
                             0, 0);
    out.resize(size);
  } else {
    out = bytes;
  }
  return out;
}

inline std::string Counted(const std::string& bytes) {
  return Pack(static_cast<std::uint32_t>(bytes.size())) + bytes;
}

// ROS 1 bag 2.0 -----------------------------------------------------------------------------------

inline std::string BagRecord(const std::vector<std::pair<std::string, std::string>>& fields,
                             const std::string& data) {
  std::string header;
  for (const auto& [name, value] : fields) header += Counted(name + "=" + value);
  return Counted(header) + Counted(data);
}

inline std::string BagTime(StampNs ns) {
  return Pack(static_cast<std::uint32_t>(ns / 1000000000),
              static_cast<std::uint32_t>(ns % 1000000000));
}

inline std::string Op(int op) { return {static_cast<char>(op)}; }

inline std::string BagConnection(std::uint32_t number, const RecordedTopic& topic) {
  std::string data;
  for (const auto& [name, value] : std::vector<std::pair<std::string, std::string>>{
           {"topic", topic.name},
           {"type", topic.type},
           {"md5sum", "abd5d1e9c3ac157a0df3ba27b65d3384"},
           {"message_definition", "float32 x\n"}}) {
    data += Counted(name + "=" + value);
  }
  return BagRecord({{"op", Op(7)}, {"conn", Pack(number)}, {"topic", topic.name}}, data);
}

struct BagOptions {
  std::string compression = "none";
  std::size_t messages_a_chunk = 3;
  bool closed = true;  // with an index
};

inline std::string BagBytes(const RecordedMessages& recorded, const BagOptions& options) {
  const auto header = [](std::uint64_t index, std::uint32_t connections, std::uint32_t chunks) {
    return "#ROSBAG V2.0\n" + BagRecord({{"op", Op(3)},
                                         {"index_pos", Pack(index)},
                                         {"conn_count", Pack(connections)},
                                         {"chunk_count", Pack(chunks)}},
                                        std::string(4027, ' '));
  };
  std::string bag = header(0, 0, 0), infos;
  std::uint32_t chunks = 0;
  const auto connections = static_cast<std::uint32_t>(recorded.topics.size());
  for (std::size_t begin = 0; begin < recorded.messages.size();) {
    const std::size_t end = std::min(begin + options.messages_a_chunk, recorded.messages.size());
    std::string chunk;
    std::map<std::uint32_t, std::string> indices;
    for (std::uint32_t c = 0; c < connections && begin == 0; ++c) {
      chunk += BagConnection(c, recorded.topics[c]);
    }
    for (; begin < end; ++begin) {
      const RecordedMessage& message = recorded.messages[begin];
      const auto connection = static_cast<std::uint32_t>(message.topic);
      indices[connection] +=
          BagTime(message.log_ns) + Pack(static_cast<std::uint32_t>(chunk.size()));
      chunk +=
          BagRecord({{"op", Op(2)}, {"conn", Pack(connection)}, {"time", BagTime(message.log_ns)}},
                    message.bytes);
    }
    std::string counts;
    const std::uint64_t place = bag.size();
    bag += BagRecord(
        {{"op", Op(5)},
         {"compression", options.compression},
         {"size", Pack(static_cast<std::uint32_t>(chunk.size()))}},
        Compressed(chunk, options.compression == "lz4" ? "lz4 of ROS 1" : options.compression));
    for (const auto& [connection, entries] : indices) {
      const auto count = static_cast<std::uint32_t>(entries.size() / 12);
      counts += Pack(connection, count);
      bag += BagRecord({{"op", Op(4)},
                        {"ver", Pack(std::uint32_t{1})},
                        {"conn", Pack(connection)},
                        {"count", Pack(count)}},
                       entries);
    }
    infos += BagRecord({{"op", Op(6)},
                        {"ver", Pack(std::uint32_t{1})},
                        {"chunk_pos", Pack(place)},
                        {"start_time", BagTime(0)},
                        {"end_time", BagTime(0)},
                        {"count", Pack(static_cast<std::uint32_t>(indices.size()))}},
                       counts);
    ++chunks;
  }
  if (!options.closed) return bag;
  const std::string head = header(bag.size(), connections, chunks);
  for (std::uint32_t c = 0; c < connections; ++c) bag += BagConnection(c, recorded.topics[c]);
  return head + bag.substr(head.size()) + infos;
}

// MCAP --------------------------------------------------------------------------------------------

inline std::string McapRecord(int opcode, const std::string& content) {
  return Op(opcode) + Pack(static_cast<std::uint64_t>(content.size())) + content;
}

inline std::uint32_t Crc(std::string_view bytes) {
  return static_cast<std::uint32_t>(
      crc32_z(0, reinterpret_cast<const Bytef*>(bytes.data()), bytes.size()));
}

struct McapOptions {
  std::string compression = "zstd";  // "" is none
  std::size_t messages_a_chunk = 3;  // 0: no chunks
  bool summary = true;
  bool crc = true;
  bool ros1 = false;
};

inline std::string McapBytes(const RecordedMessages& recorded, const McapOptions& options) {
  static const std::string kMagic("\x89MCAP0\r\n", 8);
  std::string file = kMagic + McapRecord(1, Counted(options.ros1 ? "ros1" : "ros2") + Counted("t"));
  std::string channels, chunk_indices, counts;
  std::map<std::uint16_t, std::uint64_t> count_of;
  for (std::size_t t = 0; t < recorded.topics.size(); ++t) {
    const auto id = static_cast<std::uint16_t>(t + 1);
    std::string type = recorded.topics[t].type;
    if (!options.ros1) type.replace(type.find('/'), 1, "/msg/");
    channels += McapRecord(3, Pack(id) + Counted(type) + Counted("ros2msg") + Counted("float32 x"));
    channels += McapRecord(4, Pack(id, id) + Counted(recorded.topics[t].name) +
                                  Counted(options.ros1 ? "ros1" : "cdr") + Counted(""));
  }
  if (options.messages_a_chunk == 0) file += channels;
  std::uint32_t chunks = 0;
  for (std::size_t begin = 0; begin < recorded.messages.size();) {
    const std::size_t end = std::min(begin + std::max<std::size_t>(1, options.messages_a_chunk),
                                     recorded.messages.size());
    std::string chunk = begin == 0 && options.messages_a_chunk > 0 ? channels : "";
    std::map<std::uint16_t, std::string> indices;
    std::uint64_t first_log = UINT64_MAX, last_log = 0;
    for (; begin < end; ++begin) {
      const RecordedMessage& message = recorded.messages[begin];
      const auto channel = static_cast<std::uint16_t>(message.topic + 1);
      const auto log = static_cast<std::uint64_t>(message.log_ns);
      first_log = std::min(first_log, log);
      last_log = std::max(last_log, log);
      indices[channel] += Pack(log, static_cast<std::uint64_t>(chunk.size()));
      ++count_of[channel];
      chunk += McapRecord(5, Pack(channel, std::uint32_t{0}, log, log) + message.bytes);
    }
    if (options.messages_a_chunk == 0) {
      file += chunk;
      continue;
    }
    const std::string packed = Compressed(chunk, options.compression);
    const std::uint64_t place = file.size();
    file += McapRecord(6, Pack(first_log, last_log, static_cast<std::uint64_t>(chunk.size()),
                               options.crc ? Crc(chunk) : 0U) +
                              Counted(options.compression) +
                              Pack(static_cast<std::uint64_t>(packed.size())) + packed);
    const std::uint64_t chunk_end = file.size();
    std::string places;
    for (const auto& [channel, entries] : indices) {
      places += Pack(channel, static_cast<std::uint64_t>(file.size()));
      if (options.summary) file += McapRecord(7, Pack(channel) + Counted(entries));
    }
    chunk_indices +=
        McapRecord(8, Pack(first_log, last_log, place, chunk_end - place) + Counted(places) +
                          Pack(static_cast<std::uint64_t>(file.size()) - chunk_end) +
                          Counted(options.compression) +
                          Pack(static_cast<std::uint64_t>(packed.size()),
                               static_cast<std::uint64_t>(chunk.size())));
    ++chunks;
  }
  file += McapRecord(15, Pack(std::uint32_t{0}));
  const std::uint64_t summary = options.summary ? file.size() : 0;
  std::string tail;
  if (options.summary) {
    for (const auto& [channel, count] : count_of) counts += Pack(channel, count);
    const auto topics = static_cast<std::uint16_t>(recorded.topics.size());
    tail = channels + chunk_indices +
           McapRecord(11, Pack(static_cast<std::uint64_t>(recorded.messages.size()), topics,
                               static_cast<std::uint32_t>(topics), std::uint32_t{0},
                               std::uint32_t{0}, chunks, std::uint64_t{0}, std::uint64_t{0}) +
                              Counted(counts));
  }
  tail += Op(2) + Pack(std::uint64_t{20}, summary, std::uint64_t{0});
  return file + tail + Pack(options.crc && options.summary ? Crc(tail) : 0U) + kMagic;
}

// ROS 2 bags --------------------------------------------------------------------------------------

inline void WriteDatabase(const std::string& path, const RecordedMessages& recorded,
                          bool message_zstd = false) {
  SQLite::Database db(path, SQLite::OPEN_READWRITE | SQLite::OPEN_CREATE);
  db.exec(
      "CREATE TABLE topics(id INTEGER PRIMARY KEY,name TEXT NOT NULL,type TEXT NOT NULL,"
      "serialization_format TEXT NOT NULL,offered_qos_profiles TEXT NOT NULL);"
      "CREATE TABLE messages(id INTEGER PRIMARY KEY,topic_id INTEGER NOT NULL,"
      "timestamp INTEGER NOT NULL, data BLOB NOT NULL);"
      "CREATE INDEX timestamp_idx ON messages (timestamp ASC); BEGIN");
  for (const RecordedTopic& topic : recorded.topics) {
    std::string type = topic.type;
    type.replace(type.find('/'), 1, "/msg/");
    SQLite::Statement row(db, "INSERT INTO topics VALUES(NULL, ?, ?, 'cdr', '')");
    row.bind(1, topic.name);
    row.bind(2, type);
    row.exec();
  }
  for (const RecordedMessage& message : recorded.messages) {
    const std::string bytes = Compressed(message.bytes, message_zstd ? "zstd" : "");
    SQLite::Statement row(db, "INSERT INTO messages VALUES(NULL, ?, ?, ?)");
    row.bind(1, static_cast<std::int64_t>(message.topic + 1));
    row.bind(2, static_cast<std::int64_t>(message.log_ns));
    row.bind(3, bytes.data(), static_cast<int>(bytes.size()));
    row.exec();
  }
  db.exec("COMMIT");
}

inline std::string Metadata(const std::vector<std::string>& files) {
  std::string text =
      "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: sqlite3\n"
      "  relative_file_paths:\n";
  for (const std::string& file : files) text += "    - " + file + "\n";
  return text + "  files:\n    - path: other.db3\n      message_count: 1\n";
}

// Messages ----------------------------------------------------------------------------------------

// A message field by field, as ROS 1 or CDR of either byte order has it.
class WireWriter {
 public:
  enum class Form { kRos1, kCdr, kCdrBigEndian };
  explicit WireWriter(Form form) : form_(form) {}

  template <typename T>
  WireWriter& Add(T value) {
    if (form_ != Form::kRos1)
      bytes_.resize((bytes_.size() + sizeof(T) - 1) / sizeof(T) * sizeof(T));
    std::string packed = Pack(value);
    if (form_ == Form::kCdrBigEndian) packed = {packed.rbegin(), packed.rend()};
    bytes_ += packed;
    return *this;
  }
  WireWriter& Text(const std::string& text) {
    const std::string end(form_ == Form::kRos1 ? 0 : 1, '\0');
    Add(static_cast<std::uint32_t>(text.size() + end.size()));
    bytes_ += text + end;
    return *this;
  }
  WireWriter& Raw(const std::string& bytes) {
    bytes_ += bytes;
    return *this;
  }
  WireWriter& Header(StampNs stamp_ns) {
    if (form_ == Form::kRos1) Add(std::uint32_t{7});
    Add(static_cast<std::uint32_t>(stamp_ns / 1000000000));
    Add(static_cast<std::uint32_t>(stamp_ns % 1000000000));
    return Text("lidar");
  }
  std::string Bytes() const {
    if (form_ == Form::kRos1) return bytes_;
    return (form_ == Form::kCdr ? Pack(std::uint8_t{0}, std::uint8_t{1}, std::uint16_t{0})
                                : Pack(std::uint8_t{0}, std::uint8_t{0}, std::uint16_t{0})) +
           bytes_;
  }

 private:
  Form form_;
  std::string bytes_;
};

struct WrittenField {
  std::string name;
  std::uint32_t offset = 0;
  std::uint8_t datatype = 7;
};

// `data` holds rows of `width` points of `point_step` bytes.
inline std::string CloudMessage(WireWriter::Form form, StampNs stamp_ns,
                                const std::vector<WrittenField>& fields, std::uint32_t height,
                                std::uint32_t width, std::uint32_t point_step,
                                std::uint32_t row_step, const std::string& data,
                                bool big_endian_points = false) {
  WireWriter out(form);
  out.Header(stamp_ns).Add(height).Add(width).Add(static_cast<std::uint32_t>(fields.size()));
  for (const WrittenField& field : fields) {
    out.Text(field.name).Add(field.offset).Add(field.datatype).Add(std::uint32_t{1});
  }
  out.Add(static_cast<std::uint8_t>(big_endian_points)).Add(point_step).Add(row_step);
  out.Add(static_cast<std::uint32_t>(data.size())).Raw(data).Add(std::uint8_t{1});
  return out.Bytes();
}

// x y z intensity (float32), and t (float32, s) if the scan has times.
inline std::string CloudMessage(WireWriter::Form form, StampNs stamp_ns, const Scan& scan) {
  std::vector<WrittenField> fields = {{"x", 0}, {"y", 4}, {"z", 8}, {"intensity", 12}};
  std::uint32_t step = 16;
  if (!scan.time_s.empty()) {
    fields.push_back({"t", 16});
    step = 20;
  }
  std::string data;
  for (std::size_t i = 0; i < scan.points.size(); ++i) {
    data += Pack(scan.points[i]);
    if (!scan.time_s.empty()) data += Pack(scan.time_s[i]);
  }
  const auto width = static_cast<std::uint32_t>(scan.points.size());
  return CloudMessage(form, stamp_ns, fields, 1, width, step, step * width, data);
}

}  // namespace lamina
