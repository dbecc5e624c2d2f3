#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <map>
#include <set>
#include <vector>

#include "core/base/error.h"
#include "io/points/cloud_header.h"
#include "io/points/point_file_check.h"

namespace lamina {
namespace {

using Words = std::vector<std::string_view>;

// The header of a PCD file as it is read, line by line.
struct PcdHeader {
  std::size_t fields = 0;
  std::vector<std::string_view> names, types;
  std::vector<std::size_t> sizes, counts;
  std::map<std::string_view, std::size_t> extent;  // WIDTH, HEIGHT, POINTS
};

void ReadPcdHeaderLine(const LineReader& lines, const Words& words, PcdHeader* header) {
  const std::string_view key = words[0];
  const std::size_t values = words.size() - 1;
  const auto expect = [&](std::size_t count) {
    if (values != count) lines.Fail(fmt::format("{} has {} values, found {}", key, count, values));
  };
  if (key == "FIELDS" || key == "COLUMNS") {
    if (values == 0) lines.Fail("FIELDS names no field");
    header->fields = values;
    header->names.assign(words.begin() + 1, words.end());
  } else if (key == "SIZE") {
    expect(header->fields);
    for (std::size_t i = 1; i <= values; ++i) {
      header->sizes.push_back(ParseCount(lines, words[i]));
      const std::size_t size = header->sizes.back();
      if (size != 1 && size != 2 && size != 4 && size != 8) lines.Fail("SIZE must be 1, 2, 4 or 8");
    }
  } else if (key == "TYPE") {
    expect(header->fields);
    if (header->sizes.empty()) lines.Fail("TYPE must come after SIZE");
    for (std::size_t i = 1; i <= values; ++i) {
      const bool real = words[i] == "F" && header->sizes[i - 1] >= 4;
      if (!real && words[i] != "I" && words[i] != "U") {
        lines.Fail("TYPE must be I, U, or F (with SIZE 4 or 8)");
      }
    }
    header->types.assign(words.begin() + 1, words.end());
  } else if (key == "COUNT") {
    expect(header->fields);
    for (std::size_t i = 1; i <= values; ++i) {
      header->counts.push_back(ParseCount(lines, words[i]));
      if (header->counts.back() < 1 || header->counts.back() > 65536) {
        lines.Fail("COUNT must be in 1 .. 65536");
      }
    }
  } else if (key == "WIDTH" || key == "HEIGHT" || key == "POINTS") {
    expect(1);
    header->extent[key] = ParseCount(lines, words[1]);
  } else if (key == "VIEWPOINT") {
    expect(7);
  } else if (key != "VERSION") {
    lines.Fail("is no line of a PCD header");
  }
}

// Of all header lines but DATA, which was read last.
void CheckPcdHeaderComplete(const LineReader& lines, const std::set<std::string_view>& seen,
                            PcdHeader* header) {
  if (seen.count("FIELDS") + seen.count("COLUMNS") != 1) lines.Fail("DATA without FIELDS before");
  for (const char* key : {"SIZE", "TYPE", "WIDTH", "HEIGHT", "POINTS"}) {
    if (seen.count(key) == 0) lines.Fail(fmt::format("DATA without {} before", key));
  }
  auto& extent = header->extent;
  if (extent["WIDTH"] * extent["HEIGHT"] != extent["POINTS"]) {
    lines.Fail(fmt::format("POINTS {} must be WIDTH {} times HEIGHT {}", extent["POINTS"],
                           extent["WIDTH"], extent["HEIGHT"]));
  }
  if (header->counts.empty()) header->counts.assign(header->fields, 1);
}

// PointCloudField::datatype of a PCD type.
std::uint32_t TypeOf(std::string_view type, std::size_t size) {
  const bool is_signed = type == "I";
  if (type == "F") return size == 4 ? 7 : 8;
  switch (size) {
    case 1:
      return is_signed ? 1 : 2;
    case 2:
      return is_signed ? 3 : 4;
    case 4:
      return is_signed ? 5 : 6;
    default:
      return is_signed ? 9 : 10;
  }
}

// Fields, columns and the bytes of a point.
void DescribePcdPoint(const PcdHeader& header, CloudFileLayout* layout) {
  for (std::size_t i = 0; i < header.fields; ++i) {
    const PointCloudField field{std::string(header.names[i]), layout->cloud.point_step,
                                TypeOf(header.types[i], header.sizes[i])};
    layout->cloud.fields.push_back(field);
    layout->columns.insert(layout->columns.end(), header.counts[i], field);
    layout->cloud.point_step += header.sizes[i] * header.counts[i];
  }
}

// Holds the number of points against the bytes that are there.
void CheckPcdData(std::string_view bytes, CloudFileLayout* layout, LineReader* lines) {
  const std::size_t point_bytes = layout->cloud.point_step, points = layout->points();
  const std::size_t have = bytes.size() - layout->data_offset;
  if (points > kMostCloudBytes / point_bytes) {
    lines->Fail(fmt::format("{} points of {} bytes are more than 2 GB", points, point_bytes));
  }
  const std::size_t need = points * point_bytes;
  if (layout->data == CloudFileLayout::Data::kAscii) {
    CheckNumberRows(points, layout->columns.size(), lines);
  } else if (layout->data == CloudFileLayout::Data::kBinary) {
    if (have < need) {
      lines->Fail(fmt::format("{} points of {} bytes need {} bytes of data, the file has {}",
                              points, point_bytes, need, have));
    }
  } else {
    std::uint32_t packed = 0, unpacked = 0;
    if (have < 8) lines->Fail("compressed data must start with its two sizes");
    bytes.copy(reinterpret_cast<char*>(&packed), 4, layout->data_offset);
    bytes.copy(reinterpret_cast<char*>(&unpacked), 4, layout->data_offset + 4);
    if (packed > have - 8) {
      lines->Fail(fmt::format("{} bytes of compressed data are announced, the file has {}", packed,
                              have - 8));
    }
    // LZF makes at most 264 bytes out of 3.
    if (unpacked != need || need > 100 * have) {
      lines->Fail(fmt::format("{} points of {} bytes do not come out of {} bytes that unpack to {}",
                              points, point_bytes, packed, unpacked));
    }
    layout->data_offset += 8;
    layout->packed_bytes = packed;
  }
}

// Reads the header up to and with its DATA line; false if the text ends before.
bool ReadPcdHeader(LineReader* lines, PcdHeader* header, CloudFileLayout* layout) {
  std::set<std::string_view> seen;
  while (lines->Next()) {
    const Words words = lines->Words();
    if (!seen.insert(words[0]).second) {
      lines->Fail("says again what an earlier line of the header said");
    }
    if (words[0] != "DATA") {
      ReadPcdHeaderLine(*lines, words, header);
      continue;
    }
    const std::string_view kind = words.size() == 2 ? words[1] : "";
    if (kind == "binary") layout->data = CloudFileLayout::Data::kBinary;
    if (kind == "binary_compressed") layout->data = CloudFileLayout::Data::kCompressed;
    if (layout->data == CloudFileLayout::Data::kAscii && kind != "ascii") {
      lines->Fail("DATA must be ascii, binary or binary_compressed");
    }
    CheckPcdHeaderComplete(*lines, seen, header);
    layout->cloud.width = header->extent["POINTS"];
    layout->cloud.height = 1;
    DescribePcdPoint(*header, layout);
    layout->data_offset = lines->next_offset();
    return true;
  }
  return false;
}

}  // namespace

CloudFileLayout CheckPcd(const std::string& path, std::string_view bytes) {
  LineReader lines(path, bytes);
  PcdHeader header;
  CloudFileLayout layout;
  if (!ReadPcdHeader(&lines, &header, &layout)) {
    throw InputError(fmt::format("{}: is no PCD file: ends without a DATA line", path));
  }
  CheckPcdData(bytes, &layout, &lines);
  return layout;
}

std::optional<std::size_t> DeclaredPcdBytes(std::string_view head) {
  try {
    LineReader lines("", WholeLines(head));
    PcdHeader header;
    CloudFileLayout layout;
    if (!ReadPcdHeader(&lines, &header, &layout)) return std::nullopt;
    if (layout.data == CloudFileLayout::Data::kCompressed) {
      std::uint32_t packed = 0;
      if (head.size() < layout.data_offset + 8) return std::nullopt;
      head.copy(reinterpret_cast<char*>(&packed), 4, layout.data_offset);
      return layout.data_offset + 8 + packed;
    }
    const bool ascii = layout.data == CloudFileLayout::Data::kAscii;
    // A number and a blank each; the last line may lack its end.
    const std::size_t data =
        layout.points() * (ascii ? 2 * layout.columns.size() : layout.cloud.point_step);
    return layout.data_offset + data - (ascii && data > 0 ? 1 : 0);
  } catch (const InputError&) {
    return 0;
  }
}

}  // namespace lamina
