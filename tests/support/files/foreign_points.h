// PCD and PLY files with whatever fields, types and units other programs write.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <sstream>
#include <string>
#include <type_traits>
#include <vector>

#include "core/geometry/scan.h"
#include "tests/support/files/io_test_files.h"

namespace lamina::foreign {

// What a point becomes, field by field.
struct Field {
  std::string name;
  char type;  // F, U or I, as in PCD
  std::size_t size;
  std::function<long double(const Scan&, std::size_t)> value;
};

template <typename T>
void Append(long double value, bool big_endian, std::string* bytes) {
  // Fields without a sign begin at nought: rounding may end just below.
  if (std::is_unsigned_v<T>) value = std::max(0.0L, value);
  std::string packed = Pack(static_cast<T>(value));
  if (big_endian) std::reverse(packed.begin(), packed.end());
  *bytes += packed;
}

inline void AppendField(const Field& field, long double value, bool big_endian,
                        std::string* bytes) {
  if (field.type == 'F' && field.size == 4) return Append<float>(value, big_endian, bytes);
  if (field.type == 'F') return Append<double>(value, big_endian, bytes);
  if (field.size == 1) return Append<std::uint8_t>(value, big_endian, bytes);
  if (field.size == 2) return Append<std::uint16_t>(value, big_endian, bytes);
  if (field.size == 8) return Append<std::uint64_t>(value, big_endian, bytes);
  Append<std::uint32_t>(value, big_endian, bytes);
}

inline std::vector<Field> Xyz(std::size_t size = 4) {
  return {{"x", 'F', size, [](const Scan& s, std::size_t i) { return s.points[i].x; }},
          {"y", 'F', size, [](const Scan& s, std::size_t i) { return s.points[i].y; }},
          {"z", 'F', size, [](const Scan& s, std::size_t i) { return s.points[i].z; }}};
}

inline Field Constant(const std::string& name, char type, std::size_t size, double value) {
  return {name, type, size, [value](const Scan&, std::size_t) { return value; }};
}

// Seconds from the stamp, in a unit and from another zero.
inline Field Time(const std::string& name, char type, std::size_t size, long double per_second,
                  long double zero_s = 0.0L) {
  return {name, type, size, [=](const Scan& s, std::size_t i) {
            return (static_cast<long double>(s.time_s[i]) + zero_s) * per_second;
          }};
}

inline std::vector<Field> With(std::vector<Field> fields, const std::vector<Field>& more) {
  fields.insert(fields.end(), more.begin(), more.end());
  return fields;
}

inline std::string AsciiRows(const Scan& scan, const std::vector<Field>& fields) {
  std::ostringstream text;
  text.precision(9);
  for (std::size_t i = 0; i < scan.points.size(); ++i) {
    for (const Field& field : fields) text << static_cast<double>(field.value(scan, i)) << " ";
    text << "\n";
  }
  return text.str();
}

inline std::string BinaryRows(const Scan& scan, const std::vector<Field>& fields, bool big_endian) {
  std::string bytes;
  for (std::size_t i = 0; i < scan.points.size(); ++i) {
    for (const Field& field : fields) AppendField(field, field.value(scan, i), big_endian, &bytes);
  }
  return bytes;
}

inline std::string Pcd(const Scan& scan, const std::vector<Field>& fields, bool ascii = false,
                       std::size_t height = 1) {
  std::ostringstream names, sizes, types, counts;
  for (const Field& field : fields) {
    names << " " << field.name;
    sizes << " " << field.size;
    types << " " << field.type;
    counts << " 1";
  }
  std::ostringstream head;
  head << "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS" << names.str()
       << "\nSIZE" << sizes.str() << "\nTYPE" << types.str() << "\nCOUNT" << counts.str()
       << "\nWIDTH " << scan.points.size() / height << "\nHEIGHT " << height
       << "\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " << scan.points.size() << "\nDATA "
       << (ascii ? "ascii" : "binary") << "\n";
  return head.str() + (ascii ? AsciiRows(scan, fields) : BinaryRows(scan, fields, false));
}

inline std::string Ply(const Scan& scan, const std::vector<Field>& fields,
                       const std::string& format) {
  std::ostringstream head;
  head << "ply\nformat " << format << " 1.0\ncomment made by another program\nelement vertex "
       << scan.points.size() << "\n";
  for (const Field& field : fields) {
    const char* type = field.type == 'F' ? (field.size == 4 ? "float" : "double")
                       : field.size == 1 ? "uchar"
                       : field.size == 2 ? "ushort"
                                         : "uint";
    head << "property " << type << " " << field.name << "\n";
  }
  head << "end_header\n";
  if (format == "ascii") return head.str() + AsciiRows(scan, fields);
  return head.str() + BinaryRows(scan, fields, format == "binary_big_endian");
}

}  // namespace lamina::foreign
