#include "io/recording/point_file_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cstdint>
#include <map>
#include <set>
#include <vector>

#include "core/base/error.h"
#include "io/file/text_input.h"

namespace lamina {
namespace {

using Words = std::vector<std::string_view>;

// PCL counts the bytes of a cloud in 32 bits.
constexpr std::size_t kMostCloudBytes = std::size_t{1} << 31;

// A whole number of at most 32 bits.
std::size_t ParseCount(const LineReader& lines, std::string_view word) {
  std::uint32_t count = 0;
  const char* const end = word.data() + word.size();
  const auto [ptr, error] = std::from_chars(word.data(), end, count);
  if (ptr != end || error != std::errc()) {
    lines.Fail("a count must be a whole number of at most 32 bits");
  }
  return count;
}

// Goes over the next `rows` lines, each of which must be `columns` numbers.
void CheckNumberRows(std::size_t rows, std::size_t columns, LineReader* lines) {
  std::vector<double> numbers;
  for (std::size_t row = 0; row < rows; ++row) {
    if (!lines->Next()) {
      lines->Fail(fmt::format("the file ends after {} of {} points", row, rows));
    }
    lines->Numbers(&numbers);
    if (numbers.size() != columns) {
      lines->Fail(fmt::format("a point has {} numbers, found {}", columns, numbers.size()));
    }
  }
}

// The header of a PCD file as it is read, line by line.
struct PcdHeader {
  std::size_t fields = 0;
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

// What a point takes: bytes in binary, numbers in ASCII.
struct PcdPoint {
  std::size_t bytes = 0, columns = 0;
};

PcdPoint PointOf(const PcdHeader& header) {
  PcdPoint point;
  for (std::size_t i = 0; i < header.fields; ++i) {
    point.bytes += header.sizes[i] * header.counts[i];
    point.columns += header.counts[i];
  }
  return point;
}

// Holds the number of points against the bytes that are there.
void CheckPcdData(const PcdHeader& header, const PcdLayout& layout, std::string_view bytes,
                  LineReader* lines) {
  const auto [point_bytes, columns] = PointOf(header);
  const std::size_t have = bytes.size() - layout.data_offset;
  if (layout.points > kMostCloudBytes / point_bytes) {
    lines->Fail(
        fmt::format("{} points of {} bytes are more than 2 GB", layout.points, point_bytes));
  }
  const std::size_t need = layout.points * point_bytes;
  if (layout.data == PcdLayout::Data::kAscii) {
    CheckNumberRows(layout.points, columns, lines);
  } else if (layout.data == PcdLayout::Data::kBinary) {
    if (have < need) {
      lines->Fail(fmt::format("{} points of {} bytes need {} bytes of data, the file has {}",
                              layout.points, point_bytes, need, have));
    }
  } else {
    std::uint32_t packed = 0, unpacked = 0;
    if (have < 8) lines->Fail("compressed data must start with its two sizes");
    bytes.copy(reinterpret_cast<char*>(&packed), 4, layout.data_offset);
    bytes.copy(reinterpret_cast<char*>(&unpacked), 4, layout.data_offset + 4);
    if (packed > have - 8) {
      lines->Fail(fmt::format("{} bytes of compressed data are announced, the file has {}", packed,
                              have - 8));
    }
    // LZF makes at most 264 bytes out of 3.
    if (unpacked != need || need > 100 * have) {
      lines->Fail(fmt::format("{} points of {} bytes do not come out of {} bytes that unpack to {}",
                              layout.points, point_bytes, packed, unpacked));
    }
  }
}

// Reads the header up to and with its DATA line; false if the text ends before.
bool ReadPcdHeader(LineReader* lines, PcdHeader* header, PcdLayout* layout) {
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
    if (kind == "binary") layout->data = PcdLayout::Data::kBinary;
    if (kind == "binary_compressed") layout->data = PcdLayout::Data::kCompressed;
    if (layout->data == PcdLayout::Data::kAscii && kind != "ascii") {
      lines->Fail("DATA must be ascii, binary or binary_compressed");
    }
    CheckPcdHeaderComplete(*lines, seen, header);
    layout->points = header->extent["POINTS"];
    layout->data_offset = lines->next_offset();
    return true;
  }
  return false;
}

const std::map<std::string_view, std::size_t>& PlyTypeSizes() {
  static const auto* sizes = new std::map<std::string_view, std::size_t>{
      {"char", 1},  {"uchar", 1},   {"short", 2},  {"ushort", 2}, {"int", 4},   {"uint", 4},
      {"int8", 1},  {"uint8", 1},   {"int16", 2},  {"uint16", 2}, {"int32", 4}, {"uint32", 4},
      {"float", 4}, {"float32", 4}, {"double", 8}, {"float64", 8}};
  return *sizes;
}

struct PlyProperty {
  std::string_view type, name;
};

struct PlyElement {
  std::string_view name;
  std::size_t count = 0;
  std::size_t least_bytes = 0;  // of one item in binary; lists may be empty
  std::vector<PlyProperty> properties;
  bool has_list = false;
};

struct PlyHeader {
  std::string_view format;
  std::vector<PlyElement> elements;
};

std::size_t PlyTypeSize(const LineReader& lines, std::string_view type) {
  const auto found = PlyTypeSizes().find(type);
  if (found == PlyTypeSizes().end()) lines.Fail("the property is of no type that PLY knows");
  return found->second;
}

void ReadPlyHeaderLine(const LineReader& lines, const Words& words, PlyHeader* header) {
  const std::string_view key = words[0];
  if (key == "format") {
    if (words.size() != 3) lines.Fail("must be `format <name> 1.0`");
    header->format = words[1];
  } else if (key == "element") {
    if (words.size() != 3) lines.Fail("must be `element <name> <count>`");
    if (words[1] == "range_grid") lines.Fail("range grids are not supported");
    header->elements.push_back({words[1], ParseCount(lines, words[2]), 0, {}, false});
  } else if (key == "property") {
    const bool list = words.size() == 5 && words[1] == "list";
    if (header->elements.empty() || (!list && words.size() != 3)) {
      lines.Fail("must be `property <type> <name>` or a list, after an element");
    }
    PlyElement& element = header->elements.back();
    element.least_bytes += PlyTypeSize(lines, words[list ? 2 : 1]);
    if (list) PlyTypeSize(lines, words[3]);
    element.has_list |= list;
    element.properties.push_back({words[1], words.back()});
  } else if (key == "obj_info") {
    // PCL sizes the cloud by these, whatever the number of vertices.
    if (words.size() > 1 && (words[1] == "num_cols" || words[1] == "num_rows")) {
      lines.Fail("range grids are not supported");
    }
  } else if (key != "comment") {
    lines.Fail("is no line of a PLY header");
  }
}

// PCL packs colours of a byte each into one field and trusts, to the point of ending the process,
// that all channels stand together in this order.
void CheckPlyColours(const LineReader& lines, const PlyElement& vertex) {
  std::string channels;  // the initials; a blank for any other property
  for (const PlyProperty& property : vertex.properties) {
    std::string_view name = property.name;
    if (name.substr(0, 8) == "diffuse_") name.remove_prefix(8);
    const bool colour = name == "red" || name == "green" || name == "blue" || name == "alpha";
    const bool byte = property.type == "uchar" || property.type == "uint8";
    channels += colour && byte ? name[0] : ' ';
  }
  channels.erase(0, channels.find_first_not_of(' '));
  channels.erase(channels.find_last_not_of(' ') + 1);
  if (!channels.empty() && channels != "rgb" && channels != "rgba") {
    lines.Fail("the vertex's uchar colours must be red green blue [alpha] in a row");
  }
}

// Reads the header up to and with `end_header`; false if the text ends before.
bool ReadPlyHeader(LineReader* lines, PlyHeader* header) {
  if (!lines->Next() || lines->line() != "ply") {
    lines->Fail("is no PLY file: must start with the line `ply`");
  }
  while (lines->Next()) {
    if (lines->line() != "end_header") {
      ReadPlyHeaderLine(*lines, lines->Words(), header);
      continue;
    }
    if (header->format != "ascii" && header->format != "binary_little_endian" &&
        header->format != "binary_big_endian") {
      lines->Fail("the format must be ascii, binary_little_endian or binary_big_endian");
    }
    return true;
  }
  return false;
}

// Bytes of an item of the element, at least.
std::size_t LeastItemBytes(const PlyHeader& header, const PlyElement& element) {
  return header.format == "ascii" ? 2 * element.properties.size() : element.least_bytes;
}

void CheckPlyData(const PlyHeader& header, std::size_t have, LineReader* lines) {
  const bool ascii = header.format == "ascii";
  const PlyElement* vertex = nullptr;
  for (const PlyElement& element : header.elements) {
    const std::size_t item = LeastItemBytes(header, element);
    if (item == 0 || element.count > (have + (ascii ? 1 : 0)) / item) {
      lines->Fail(fmt::format("{} items of element '{}' do not fit the {} bytes of data left",
                              element.count, element.name, have));
    }
    have -= std::min(have, element.count * item);
    if (element.name != "vertex") continue;
    if (vertex != nullptr) lines->Fail("there must be one element 'vertex'");
    vertex = &element;
  }
  if (vertex == nullptr) lines->Fail("there is no element 'vertex'");
  if (vertex->has_list) lines->Fail("lists in the element 'vertex' are not supported");
  if (vertex->count * (vertex->least_bytes + 4) > kMostCloudBytes) {
    lines->Fail("the vertices take more than 2 GB");
  }
  CheckPlyColours(*lines, *vertex);
  if (!ascii) return;
  for (const PlyElement* element = header.elements.data(); element != vertex; ++element) {
    for (std::size_t i = 0; i < element->count; ++i) lines->Next();
  }
  CheckNumberRows(vertex->count, vertex->properties.size(), lines);
}

// Without a last line that has no end yet.
std::string_view WholeLines(std::string_view text) { return text.substr(0, text.rfind('\n') + 1); }

}  // namespace

PcdLayout CheckPcd(const std::string& path, std::string_view bytes) {
  LineReader lines(path, bytes);
  PcdHeader header;
  PcdLayout layout;
  if (!ReadPcdHeader(&lines, &header, &layout)) {
    throw InputError(fmt::format("{}: is no PCD file: ends without a DATA line", path));
  }
  CheckPcdData(header, layout, bytes, &lines);
  return layout;
}

void CheckPly(const std::string& path, std::string_view bytes) {
  LineReader lines(path, bytes);
  PlyHeader header;
  if (!ReadPlyHeader(&lines, &header)) {
    throw InputError(fmt::format("{}: is no PLY file: ends without `end_header`", path));
  }
  CheckPlyData(header, bytes.size() - lines.next_offset(), &lines);
}

std::optional<std::size_t> DeclaredPcdBytes(std::string_view head) {
  try {
    LineReader lines("", WholeLines(head));
    PcdHeader header;
    PcdLayout layout;
    if (!ReadPcdHeader(&lines, &header, &layout)) return std::nullopt;
    if (layout.data == PcdLayout::Data::kCompressed) {
      std::uint32_t packed = 0;
      if (head.size() < layout.data_offset + 8) return std::nullopt;
      head.copy(reinterpret_cast<char*>(&packed), 4, layout.data_offset);
      return layout.data_offset + 8 + packed;
    }
    const PcdPoint point = PointOf(header);
    const bool ascii = layout.data == PcdLayout::Data::kAscii;
    // A number and a blank each; the last line may lack its end.
    const std::size_t data = layout.points * (ascii ? 2 * point.columns : point.bytes);
    return layout.data_offset + data - (ascii && data > 0 ? 1 : 0);
  } catch (const InputError&) {
    return 0;
  }
}

std::optional<std::size_t> DeclaredPlyBytes(std::string_view head) {
  try {
    LineReader lines("", WholeLines(head));
    PlyHeader header;
    if (WholeLines(head).empty() || !ReadPlyHeader(&lines, &header)) return std::nullopt;
    std::size_t data = 0;
    for (const PlyElement& element : header.elements) {
      data += element.count * LeastItemBytes(header, element);
    }
    return lines.next_offset() + data - (header.format == "ascii" && data > 0 ? 1 : 0);
  } catch (const InputError&) {
    return 0;
  }
}

}  // namespace lamina
