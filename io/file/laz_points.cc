#include "io/file/laz_points.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <utility>

#include "core/base/error.h"
#include "io/file/arithmetic_coder.h"
#include "io/file/laz_models.h"

namespace lamina {
namespace {

enum ItemType : std::uint16_t { kByte = 0, kPoint10 = 6, kGpsTime11 = 7, kRgb12 = 8 };

template <typename T>
T NumberAt(std::string_view bytes, std::size_t at) {
  T value;
  std::memcpy(&value, bytes.data() + at, sizeof(T));
  return value;
}

template <typename T>
void Put(T value, std::string* bytes) {
  bytes->append(reinterpret_cast<const char*>(&value), sizeof(T));
}

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
      if (item.type == kPoint10) point_ = std::make_unique<Point10Model>(first);
      if (item.type == kGpsTime11) time_ = std::make_unique<GpsTimeModel>(first);
      if (item.type == kRgb12) colour_ = std::make_unique<Rgb12Model>(first);
      if (item.type == kByte) extra_ = std::make_unique<ExtraBytesModel>(first, item.bytes);
      first += item.bytes;
    }
  }

  template <typename Coder>
  void Code(char* record, Coder* coder) {
    for (const LazItem& item : layout_.items) {
      if (item.type == kPoint10) point_->Code(record, coder);
      if (item.type == kGpsTime11) time_->Code(record, coder);
      if constexpr (!Coder::kEncodes) {
        if (item.type == kRgb12) colour_->Decode(record, coder);
        if (item.type == kByte) extra_->Decode(record, coder);
      }
      record += item.bytes;
    }
  }

 private:
  const LazLayout& layout_;
  std::unique_ptr<Point10Model> point_;
  std::unique_ptr<GpsTimeModel> time_;
  std::unique_ptr<Rgb12Model> colour_;
  std::unique_ptr<ExtraBytesModel> extra_;
};

bool IsKnown(const LazItem& item) {
  const bool fits = item.type == kByte ? item.bytes > 0 && item.bytes <= 1024
                                       : (item.type == kPoint10 && item.bytes == 20) ||
                                             (item.type == kGpsTime11 && item.bytes == 8) ||
                                             (item.type == kRgb12 && item.bytes == 6);
  return fits && item.version == 2;
}

}  // namespace

std::size_t LazLayout::record_bytes() const {
  std::size_t bytes = 0;
  for (const LazItem& item : items) bytes += item.bytes;
  return bytes;
}

LazLayout ParseLazRecord(std::string_view record, const std::string& name) {
  constexpr std::size_t kHeadBytes = 34, kItemBytes = 6, kMostItems = 4;
  constexpr std::uint16_t kChunked = 2;
  if (record.size() < kHeadBytes) {
    throw InputError(fmt::format("{}: does not tell how its points are compressed", name));
  }
  LazLayout layout;
  layout.chunk_points = NumberAt<std::uint32_t>(record, 12);
  const auto items = NumberAt<std::uint16_t>(record, 32);
  const auto compressor = NumberAt<std::uint16_t>(record, 0);
  bool known = compressor == kChunked && NumberAt<std::uint16_t>(record, 2) == 0 && items >= 1 &&
               items <= kMostItems && record.size() >= kHeadBytes + items * kItemBytes &&
               layout.chunk_points > 0 && layout.chunk_points < UINT32_MAX;
  std::array<bool, 9> seen{};
  for (std::size_t i = 0; known && i < items; ++i) {
    const std::size_t at = kHeadBytes + i * kItemBytes;
    const LazItem item{NumberAt<std::uint16_t>(record, at), NumberAt<std::uint16_t>(record, at + 2),
                       NumberAt<std::uint16_t>(record, at + 4)};
    known = IsKnown(item) && !std::exchange(seen[item.type], true) &&
            (i == 0) == (item.type == kPoint10);
    layout.items.push_back(item);
  }
  if (!known) {
    throw InputError(
        fmt::format("{}: its points are compressed in a way that is not read (that of LAS point "
                    "formats 0 to 3 is; `las2las` or `pdal translate` makes a LAS file of it)",
                    name));
  }
  return layout;
}

LazLayout LazLayoutOfFormat1() {
  LazLayout layout;
  layout.items = {{kPoint10, 20, 2}, {kGpsTime11, 8, 2}};
  return layout;
}

std::string LazRecord(const LazLayout& layout) {
  std::string record;
  Put<std::uint16_t>(2, &record);  // points one by one, in chunks
  Put<std::uint16_t>(0, &record);  // the arithmetic coder
  record += std::string("\2\2\0\0", 4);
  Put<std::uint32_t>(0, &record);
  Put(layout.chunk_points, &record);
  Put<std::int64_t>(-1, &record);
  Put<std::int64_t>(-1, &record);
  Put(static_cast<std::uint16_t>(layout.items.size()), &record);
  for (const LazItem& item : layout.items) {
    Put(item.type, &record);
    Put(item.bytes, &record);
    Put(item.version, &record);
  }
  return record;
}

std::string PackLazChunk(const LazLayout& layout, std::string_view records) {
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
                    const std::string& name, std::string* records) {
  const std::size_t bytes = layout.record_bytes();
  if (chunk.size() < bytes) throw InputError(fmt::format("{}: compressed points end early", name));
  records->assign(chunk.substr(0, bytes));
  if (points < 2) return;
  ArithmeticDecoder coder(chunk.substr(bytes), name);
  RecordModel model(layout, chunk.data());
  std::string record(bytes, '\0');
  for (std::uint64_t i = 1; i < points; ++i) {
    model.Code(record.data(), &coder);
    *records += record;
  }
}

std::string LazChunkTable(const std::vector<std::uint32_t>& chunk_bytes) {
  std::string table;
  Put<std::uint32_t>(0, &table);
  Put(static_cast<std::uint32_t>(chunk_bytes.size()), &table);
  ArithmeticEncoder coder(&table);
  NumberModel numbers(32, 2);
  std::uint32_t before = 0;
  for (const std::uint32_t bytes : chunk_bytes) {
    numbers.Code(Signed(before), Signed(bytes), 1, &coder);
    before = bytes;
  }
  coder.Finish();
  return table;
}

std::vector<std::uint32_t> ParseLazChunkTable(std::string_view table, std::size_t most,
                                              const std::string& name) {
  constexpr std::size_t kHeadBytes = 8;
  if (table.size() < kHeadBytes || NumberAt<std::uint32_t>(table, 0) != 0) {
    throw InputError(fmt::format("{}: the table of its compressed points is damaged", name));
  }
  const auto count = NumberAt<std::uint32_t>(table, 4);
  if (count > most) {
    throw InputError(
        fmt::format("{}: {} chunks of compressed points for at most {}", name, count, most));
  }
  std::vector<std::uint32_t> chunk_bytes;
  if (count == 0) return chunk_bytes;
  ArithmeticDecoder coder(table.substr(kHeadBytes), name);
  NumberModel numbers(32, 2);
  std::uint32_t before = 0;
  for (std::uint32_t i = 0; i < count; ++i) {
    before = Unsigned(numbers.Code(Signed(before), 0, 1, &coder));
    chunk_bytes.push_back(before);
  }
  return chunk_bytes;
}

}  // namespace lamina
