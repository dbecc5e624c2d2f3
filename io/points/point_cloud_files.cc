#include "io/points/point_cloud_files.h"

#include <fmt/format.h>
#include <lzf.h>

#include <charconv>
#include <cstdint>
#include <cstring>
#include <string_view>
#include <vector>

#include "core/base/error.h"
#include "io/file/byte_numbers.h"
#include "io/file/text_input.h"
#include "io/points/point_cloud.h"
#include "io/points/point_file_check.h"

namespace lamina {
namespace {

// Whole numbers of 64 bits have no room in a double; a decimal point is cut off behind them.
template <typename T>
void AppendWhole(std::string_view word, std::string* bytes) {
  T value = 0;
  const char* const end = word.data() + word.size();
  const auto [ptr, error] = std::from_chars(word.data(), end, value);
  if (ptr != end || error != std::errc()) {
    double real = 0.0;
    ParseNumber(word, &real);
    // Out of the type's range there is nothing right to say; a cast would be undefined.
    const bool fits = real > -9.2e18 && real < 9.2e18;
    value = static_cast<T>(fits ? static_cast<std::int64_t>(real) : 0);
  }
  AppendNumber(value, bytes);
}

// The word of a column as a value of its field's type (PointCloudField::datatype).
void AppendWord(std::string_view word, std::uint32_t datatype, std::string* bytes) {
  double real = 0.0;
  switch (datatype) {
    case 1:
      return AppendWhole<std::int8_t>(word, bytes);
    case 2:
      return AppendWhole<std::uint8_t>(word, bytes);
    case 3:
      return AppendWhole<std::int16_t>(word, bytes);
    case 4:
      return AppendWhole<std::uint16_t>(word, bytes);
    case 5:
      return AppendWhole<std::int32_t>(word, bytes);
    case 6:
      return AppendWhole<std::uint32_t>(word, bytes);
    case 9:
      return AppendWhole<std::int64_t>(word, bytes);
    case 10:
      return AppendWhole<std::uint64_t>(word, bytes);
    case 7:
      ParseNumber(word, &real);
      return AppendNumber(static_cast<float>(real), bytes);
    default:
      ParseNumber(word, &real);
      return AppendNumber(real, bytes);
  }
}

// The rows of an ASCII file, which have been checked, as binary ones.
std::string BinaryRows(const CloudFileLayout& layout, std::string_view rows) {
  LineReader lines("", rows);
  std::string bytes;
  bytes.reserve(layout.points() * layout.cloud.point_step);
  for (std::size_t i = 0; i < layout.skipped_lines; ++i) lines.Next();
  for (std::size_t i = 0; i < layout.points() && lines.Next(); ++i) {
    const std::vector<std::string_view> words = lines.Words();
    std::size_t column = 0;
    for (const PointCloudField& field : layout.columns) {
      AppendWord(words.at(column++), field.datatype, &bytes);
    }
  }
  return bytes;
}

// Compressed data hold field after field, each of all points.
std::string Unpacked(const std::string& path, const CloudFileLayout& layout,
                     std::string_view packed) {
  std::string by_field(layout.points() * layout.cloud.point_step, '\0');
  const unsigned int size =
      lzf_decompress(packed.data(), static_cast<unsigned int>(packed.size()), by_field.data(),
                     static_cast<unsigned int>(by_field.size()));
  if (size != by_field.size()) {
    throw InputError(fmt::format("{}: cannot be read: the compressed data is damaged", path));
  }
  std::string rows(by_field.size(), '\0');
  std::size_t from = 0;
  for (std::size_t f = 0; f < layout.cloud.fields.size(); ++f) {
    const std::size_t begin = layout.cloud.fields[f].offset;
    const std::size_t end = f + 1 < layout.cloud.fields.size() ? layout.cloud.fields[f + 1].offset
                                                               : layout.cloud.point_step;
    for (std::size_t i = 0; i < layout.points(); ++i, from += end - begin) {
      std::memcpy(&rows[i * layout.cloud.point_step + begin], &by_field[from], end - begin);
    }
  }
  return rows;
}

Scan ScanOf(const std::string& path, const CloudFileLayout& layout, std::string_view bytes,
            PointTimeUnit unit, PointTimeField* times) {
  if (layout.points() == 0) throw InputError(fmt::format("{}: is empty: holds no points", path));
  std::string rows;
  std::string_view data = bytes.substr(layout.data_offset);
  if (layout.data == CloudFileLayout::Data::kAscii) {
    data = rows = BinaryRows(layout, data);
  } else if (layout.data == CloudFileLayout::Data::kCompressed) {
    data = rows = Unpacked(path, layout, data.substr(0, layout.packed_bytes));
  }
  return ScanFromCloud(layout.cloud, data, KeptPoints::kAll, unit, path, times);
}

}  // namespace

Scan ReadPcd(const std::string& path, PointTimeUnit unit, PointTimeField* times) {
  const std::string bytes = ReadFile(path);
  return ScanOf(path, CheckPcd(path, bytes), bytes, unit, times);
}

Scan ReadPly(const std::string& path, PointTimeUnit unit, PointTimeField* times) {
  const std::string bytes = ReadFile(path);
  return ScanOf(path, CheckPly(path, bytes), bytes, unit, times);
}

}  // namespace lamina
