#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <map>
#include <vector>

#include "core/base/error.h"
#include "io/points/cloud_header.h"
#include "io/points/point_file_check.h"

namespace lamina {
namespace {

using Words = std::vector<std::string_view>;

struct PlyType {
  std::size_t size;
  std::uint32_t datatype;  // PointCloudField::datatype
};

const std::map<std::string_view, PlyType>& PlyTypes() {
  static const auto* types = new std::map<std::string_view, PlyType>{
      {"char", {1, 1}},  {"int8", {1, 1}},    {"uchar", {1, 2}},  {"uint8", {1, 2}},
      {"short", {2, 3}}, {"int16", {2, 3}},   {"ushort", {2, 4}}, {"uint16", {2, 4}},
      {"int", {4, 5}},   {"int32", {4, 5}},   {"uint", {4, 6}},   {"uint32", {4, 6}},
      {"float", {4, 7}}, {"float32", {4, 7}}, {"double", {8, 8}}, {"float64", {8, 8}}};
  return *types;
}

struct PlyProperty {
  PlyType type;  // of its items, if it is a list
  std::string_view name;
  std::size_t list_size = 0;  // of the number of items, if it is a list
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

PlyType PlyTypeOf(const LineReader& lines, std::string_view type) {
  const auto found = PlyTypes().find(type);
  if (found == PlyTypes().end()) lines.Fail("the property is of no type that PLY knows");
  return found->second;
}

void ReadPlyHeaderLine(const LineReader& lines, const Words& words, PlyHeader* header) {
  const std::string_view key = words[0];
  if (key == "format") {
    if (words.size() != 3) lines.Fail("must be `format <name> 1.0`");
    header->format = words[1];
  } else if (key == "element") {
    if (words.size() != 3) lines.Fail("must be `element <name> <count>`");
    header->elements.push_back({words[1], ParseCount(lines, words[2]), 0, {}, false});
  } else if (key == "property") {
    const bool list = words.size() == 5 && words[1] == "list";
    if (header->elements.empty() || (!list && words.size() != 3)) {
      lines.Fail("must be `property <type> <name>` or a list, after an element");
    }
    PlyElement& element = header->elements.back();
    const std::size_t first = PlyTypeOf(lines, words[list ? 2 : 1]).size;
    element.least_bytes += first;
    element.has_list |= list;
    element.properties.push_back(
        {PlyTypeOf(lines, words[list ? 3 : 1]), words.back(), list ? first : 0});
  } else if (key != "comment" && key != "obj_info") {
    lines.Fail("is no line of a PLY header");
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

// The vertices; everything that is announced must fit the `have` bytes of data.
const PlyElement& CheckPlyElements(const PlyHeader& header, std::size_t have,
                                   const LineReader& lines) {
  const bool ascii = header.format == "ascii";
  const PlyElement* vertex = nullptr;
  for (const PlyElement& element : header.elements) {
    const std::size_t item = LeastItemBytes(header, element);
    if (item == 0 || element.count > (have + (ascii ? 1 : 0)) / item) {
      lines.Fail(fmt::format("{} items of element '{}' do not fit the {} bytes of data left",
                             element.count, element.name, have));
    }
    have -= std::min(have, element.count * item);
    if (element.name != "vertex") continue;
    if (vertex != nullptr) lines.Fail("there must be one element 'vertex'");
    vertex = &element;
  }
  if (vertex == nullptr) lines.Fail("there is no element 'vertex'");
  if (vertex->has_list) lines.Fail("lists in the element 'vertex' are not supported");
  if (vertex->count * vertex->least_bytes > kMostCloudBytes) {
    lines.Fail("the vertices take more than 2 GB");
  }
  return *vertex;
}

void DescribePlyPoint(const PlyElement& vertex, CloudFileLayout* layout) {
  for (const PlyProperty& property : vertex.properties) {
    layout->cloud.fields.push_back(
        {std::string(property.name), layout->cloud.point_step, property.type.datatype});
    layout->cloud.point_step += property.type.size;
  }
  layout->columns = layout->cloud.fields;
  layout->cloud.width = vertex.count;
  layout->cloud.height = 1;
}

// The number of items of a list: the first bytes of `bytes`, an unsigned integer.
std::uint64_t ListLength(std::string_view bytes, bool big_endian) {
  std::uint64_t length = 0;
  for (std::size_t i = 0; i < bytes.size(); ++i) {
    const std::size_t at = big_endian ? i : bytes.size() - 1 - i;
    length = length << 8 | static_cast<std::uint8_t>(bytes[at]);
  }
  return length;
}

// Where the binary data of an element that begins at `offset` ends.
std::size_t EndOfElement(const PlyElement& element, std::string_view bytes, std::size_t offset,
                         bool big_endian, const LineReader& lines) {
  if (!element.has_list) return offset + element.count * element.least_bytes;
  const auto need = [&](std::uint64_t more) {
    if (more > bytes.size() - offset) {
      lines.Fail(fmt::format("the file ends within the element '{}'", element.name));
    }
  };
  for (std::size_t i = 0; i < element.count; ++i) {
    for (const PlyProperty& property : element.properties) {
      std::uint64_t items = 1;
      if (property.list_size > 0) {
        need(property.list_size);
        items = ListLength(bytes.substr(offset, property.list_size), big_endian);
        offset += property.list_size;
        need(items);  // the product below cannot overflow then
      }
      need(items * property.type.size);
      offset += static_cast<std::size_t>(items) * property.type.size;
    }
  }
  return offset;
}

void CheckPlyData(const PlyHeader& header, std::string_view bytes, CloudFileLayout* layout,
                  LineReader* lines) {
  const PlyElement& vertex = CheckPlyElements(header, bytes.size() - layout->data_offset, *lines);
  DescribePlyPoint(vertex, layout);
  if (header.format == "ascii") {
    for (const PlyElement* element = header.elements.data(); element != &vertex; ++element) {
      layout->skipped_lines += element->count;
    }
    for (std::size_t i = 0; i < layout->skipped_lines; ++i) lines->Next();
    return CheckNumberRows(vertex.count, vertex.properties.size(), lines);
  }
  layout->data = CloudFileLayout::Data::kBinary;
  layout->cloud.big_endian = header.format == "binary_big_endian";
  for (const PlyElement* element = header.elements.data(); element != &vertex; ++element) {
    layout->data_offset =
        EndOfElement(*element, bytes, layout->data_offset, layout->cloud.big_endian, *lines);
  }
  const std::size_t need = vertex.count * vertex.least_bytes;
  if (layout->data_offset > bytes.size() || need > bytes.size() - layout->data_offset) {
    lines->Fail(fmt::format("{} vertices need {} bytes, fewer are left", vertex.count, need));
  }
}

}  // namespace

CloudFileLayout CheckPly(const std::string& path, std::string_view bytes) {
  LineReader lines(path, bytes);
  PlyHeader header;
  if (!ReadPlyHeader(&lines, &header)) {
    throw InputError(fmt::format("{}: is no PLY file: ends without `end_header`", path));
  }
  CloudFileLayout layout;
  layout.data_offset = lines.next_offset();
  CheckPlyData(header, bytes, &layout, &lines);
  return layout;
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
