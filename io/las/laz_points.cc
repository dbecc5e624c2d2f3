#include "io/las/laz_points.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <iterator>
#include <memory>
#include <utility>

#include "core/base/error.h"
#include "io/file/byte_numbers.h"
#include "io/las/arithmetic_coder.h"
#include "io/las/laz_layers.h"
#include "io/las/laz_point10.h"

namespace lamina {
namespace {

constexpr std::uint16_t kPointwise = 2, kLayered = 3;  // both in chunks

// Colours, which are read past.
class Rgb12Model {
 public:
  explicit Rgb12Model(const char* first) { std::memcpy(last_.data(), first, 6); }

  void Decode(char* bytes, ArithmeticDecoder* coder) {
    const std::uint32_t used = coder->Symbol(0, &used_);
    std::array<std::uint8_t, 6> now = last_;
    const auto code = [&](std::size_t i, int predicted) {
      now[i] = static_cast<std::uint8_t>(coder->Symbol(0, &bytes_[i]) +
                                         static_cast<std::uint32_t>(std::clamp(predicted, 0, 255)));
    };
    for (std::size_t i = 0; i < 2; ++i) {
      if ((used >> i & 1U) != 0) code(i, last_[i]);
    }
    // Green and blue mostly change as red does; or all are the same.
    for (std::size_t i = 0; i < 2; ++i) {
      if ((used & 64U) == 0) {
        now[i + 2] = now[i + 4] = now[i];
        continue;
      }
      int change = now[i] - last_[i];
      if ((used >> (i + 2) & 1U) != 0) code(i + 2, change + last_[i + 2]);
      change = (change + now[i + 2] - last_[i + 2]) / 2;
      if ((used >> (i + 4) & 1U) != 0) code(i + 4, change + last_[i + 4]);
    }
    last_ = now;
    std::memcpy(bytes, now.data(), 6);
  }

 private:
  std::array<std::uint8_t, 6> last_{};  // low and high byte of red, green, blue
  SymbolModel used_{128};
  std::vector<SymbolModel> bytes_ = std::vector<SymbolModel>(6, SymbolModel(256));
};

class ExtraBytesModel {
 public:
  ExtraBytesModel(const char* first, std::size_t count)
      : last_(first, count), models_(count, SymbolModel(256)) {}

  void Decode(char* bytes, ArithmeticDecoder* coder) {
    for (std::size_t i = 0; i < last_.size(); ++i) {
      last_[i] =
          static_cast<char>(static_cast<unsigned char>(last_[i]) + coder->Symbol(0, &models_[i]));
    }
    std::memcpy(bytes, last_.data(), last_.size());
  }

 private:
  std::string last_;
  std::vector<SymbolModel> models_;
};

// All items of a record, one after the other.
class RecordModel {
 public:
  RecordModel(const LazLayout& layout, const char* first) : layout_(layout) {
    for (const LazItem& item : layout.items) {
      if (item.type == kLazPoint10) point_ = std::make_unique<Point10Model>(first);
      if (item.type == kLazGpsTime11) {
        time_ = std::make_unique<GpsTimeModel>(NumberAt<std::int64_t>({first, 8}, 0),
                                               GpsTimeModel::Repeats::kCoded);
      }
      if (item.type == kLazRgb12) colour_ = std::make_unique<Rgb12Model>(first);
      if (item.type == kLazByte) extra_ = std::make_unique<ExtraBytesModel>(first, item.bytes);
      first += item.bytes;
    }
  }

  template <typename Coder>
  void Code(char* record, Coder* coder) {
    for (const LazItem& item : layout_.items) {
      if (item.type == kLazPoint10) point_->Code(record, coder);
      if (item.type == kLazGpsTime11) CodeTime(record, coder);
      if constexpr (!Coder::kEncodes) {
        if (item.type == kLazRgb12) colour_->Decode(record, coder);
        if (item.type == kLazByte) extra_->Decode(record, coder);
      }
      record += item.bytes;
    }
  }

 private:
  template <typename Coder>
  void CodeTime(char* bytes, Coder* coder) {
    std::int64_t time = 0;
    std::memcpy(&time, bytes, sizeof(time));
    time = time_->Code(time, coder);
    std::memcpy(bytes, &time, sizeof(time));
  }

  const LazLayout& layout_;
  std::unique_ptr<Point10Model> point_;
  std::unique_ptr<GpsTimeModel> time_;
  std::unique_ptr<Rgb12Model> colour_;
  std::unique_ptr<ExtraBytesModel> extra_;
};

struct KnownItem {
  LazItemType type;
  bool layered;
  std::uint16_t bytes;  // 0: any
};
constexpr KnownItem kKnownItems[] = {
    {kLazPoint10, false, 20}, {kLazGpsTime11, false, 8},    {kLazRgb12, false, 6},
    {kLazByte, false, 0},     {kLazPoint14, true, 30},      {kLazRgb14, true, 6},
    {kLazRgbNir14, true, 8},  {kLazWavePacket14, true, 29}, {kLazByte14, true, 0}};

bool IsKnown(const LazItem& item, bool layered) {
  constexpr std::uint16_t kMostExtraBytes = 1024;
  if (layered ? item.version != 3 && item.version != 4 : item.version != 2) return false;
  return std::any_of(std::begin(kKnownItems), std::end(kKnownItems), [&](const KnownItem& known) {
    const bool fits = known.bytes == 0 ? item.bytes > 0 && item.bytes <= kMostExtraBytes
                                       : item.bytes == known.bytes;
    return item.type == known.type && layered == known.layered && fits;
  });
}

// Two numbers a chunk where they have any number of points, else one.
template <typename Coder>
LazChunk CodeChunk(const LazChunk& before, LazChunk chunk, bool any, NumberModel* numbers,
                   Coder* coder) {
  if (any) {
    chunk.points = Unsigned(numbers->Code(Signed(before.points), Signed(chunk.points), 0, coder));
  }
  chunk.bytes = Unsigned(numbers->Code(Signed(before.bytes), Signed(chunk.bytes), 1, coder));
  return chunk;
}

}  // namespace

std::size_t LazLayout::record_bytes() const {
  std::size_t bytes = 0;
  for (const LazItem& item : items) bytes += item.bytes;
  return bytes;
}

LazLayout ParseLazRecord(std::string_view record, const std::string& name) {
  constexpr std::size_t kHeadBytes = 34, kItemBytes = 6, kMostItems = 4;
  if (record.size() < kHeadBytes) {
    throw InputError(fmt::format("{}: does not tell how its points are compressed", name));
  }
  LazLayout layout;
  layout.chunk_points = NumberAt<std::uint32_t>(record, 12);
  const auto items = NumberAt<std::uint16_t>(record, 32);
  const auto compressor = NumberAt<std::uint16_t>(record, 0);
  layout.layered = compressor == kLayered;
  const LazItemType point = layout.layered ? kLazPoint14 : kLazPoint10;
  bool known = (compressor == kPointwise || layout.layered) &&
               NumberAt<std::uint16_t>(record, 2) == 0 && items >= 1 && items <= kMostItems &&
               record.size() >= kHeadBytes + items * kItemBytes && layout.chunk_points > 0 &&
               (layout.layered || layout.chunk_points != kLazAnyPoints);
  std::array<bool, kLazByte14 + 1> seen{};
  for (std::size_t i = 0; known && i < items; ++i) {
    const std::size_t at = kHeadBytes + i * kItemBytes;
    const LazItem item{NumberAt<std::uint16_t>(record, at), NumberAt<std::uint16_t>(record, at + 2),
                       NumberAt<std::uint16_t>(record, at + 4)};
    known = IsKnown(item, layout.layered) && !std::exchange(seen[item.type], true) &&
            (i == 0) == (item.type == point);
    layout.items.push_back(item);
  }
  if (!known) {
    throw InputError(fmt::format(
        "{}: its points are compressed in a way that is not read (that of LASzip 2 and 3 "
        "for LAS point formats 0 to 3 and 6 to 10 is; `las2las` or `pdal translate` "
        "makes a LAS file of it)",
        name));
  }
  return layout;
}

LazLayout LazLayoutOfFormat1() {
  LazLayout layout;
  layout.items = {{kLazPoint10, 20, 2}, {kLazGpsTime11, 8, 2}};
  return layout;
}

LazLayout LazLayoutOfFormat6(std::uint32_t chunk_points) {
  LazLayout layout;
  layout.layered = true;
  layout.chunk_points = chunk_points;
  layout.items = {{kLazPoint14, 30, 3}};
  return layout;
}

std::string LazRecord(const LazLayout& layout) {
  std::string record;
  AppendNumber(layout.layered ? kLayered : kPointwise, &record);
  AppendNumber<std::uint16_t>(0, &record);  // the arithmetic coder
  const char version = layout.layered ? 3 : 2;
  record += std::string{version, version, 0, 0};
  AppendNumber<std::uint32_t>(0, &record);
  AppendNumber(layout.chunk_points, &record);
  AppendNumber<std::int64_t>(-1, &record);
  AppendNumber<std::int64_t>(-1, &record);
  AppendNumber(static_cast<std::uint16_t>(layout.items.size()), &record);
  for (const LazItem& item : layout.items) {
    AppendNumber(item.type, &record);
    AppendNumber(item.bytes, &record);
    AppendNumber(item.version, &record);
  }
  return record;
}

std::string PackLazChunk(const LazLayout& layout, std::string_view records) {
  if (layout.layered) return PackLayeredChunk(records);
  const std::size_t bytes = layout.record_bytes();
  std::string chunk(records.substr(0, bytes));
  ArithmeticEncoder coder(&chunk);
  RecordModel model(layout, records.data());
  std::string record;
  for (std::size_t at = bytes; at < records.size(); at += bytes) {
    record = records.substr(at, bytes);
    model.Code(record.data(), &coder);
  }
  coder.Finish();
  return chunk;
}

void UnpackLazChunk(const LazLayout& layout, std::string_view chunk, std::uint64_t points,
                    const std::string& name, const LazVisitor& visit) {
  const std::size_t bytes = layout.record_bytes();
  if (chunk.size() < bytes) throw InputError(fmt::format("{}: compressed points end early", name));
  if (layout.layered) return UnpackLayeredChunk(layout, chunk, points, name, visit);
  visit(chunk.substr(0, bytes));
  if (points < 2) return;
  ArithmeticDecoder coder(chunk.substr(bytes), name);
  RecordModel model(layout, chunk.data());
  std::string record(bytes, '\0');
  for (std::uint64_t i = 1; i < points; ++i) {
    model.Code(record.data(), &coder);
    visit(record);
  }
}

std::string LazChunkTable(const LazLayout& layout, const std::vector<LazChunk>& chunks) {
  std::string table;
  AppendNumber<std::uint32_t>(0, &table);
  AppendNumber(static_cast<std::uint32_t>(chunks.size()), &table);
  ArithmeticEncoder coder(&table);
  NumberModel numbers(32, 2);
  const bool any = layout.chunk_points == kLazAnyPoints;
  LazChunk before;
  for (const LazChunk& chunk : chunks) before = CodeChunk(before, chunk, any, &numbers, &coder);
  coder.Finish();
  return table;
}

std::vector<LazChunk> ParseLazChunkTable(const LazLayout& layout, std::string_view table,
                                         std::size_t most, const std::string& name) {
  constexpr std::size_t kHeadBytes = 8;
  if (table.size() < kHeadBytes || NumberAt<std::uint32_t>(table, 0) != 0) {
    throw InputError(fmt::format("{}: the table of its compressed points is damaged", name));
  }
  const auto count = NumberAt<std::uint32_t>(table, 4);
  if (count > most) {
    throw InputError(
        fmt::format("{}: {} chunks of compressed points for at most {}", name, count, most));
  }
  std::vector<LazChunk> chunks;
  if (count == 0) return chunks;
  ArithmeticDecoder coder(table.substr(kHeadBytes), name);
  NumberModel numbers(32, 2);
  const bool any = layout.chunk_points == kLazAnyPoints;
  LazChunk before;
  for (std::uint32_t i = 0; i < count; ++i) {
    before = CodeChunk(before, LazChunk(), any, &numbers, &coder);
    chunks.push_back(before);
  }
  return chunks;
}

}  // namespace lamina
