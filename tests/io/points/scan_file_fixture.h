// Point files that tests write and read back.
#pragma once

#include <gmock/gmock.h>

#include <string>
#include <string_view>

#include "io/points/scan_file.h"
#include "io/recording/scan_source.h"
#include "tests/support/files/io_test_files.h"

namespace lamina {

class ScanFileTest : public FilesTest {
 protected:
  Scan Read(const std::string& name, std::string_view bytes) const {
    return ReadScanFile(Write(name, bytes), options_.point_time_unit);
  }
  std::string ReadError(const std::string& name, std::string_view bytes) const {
    const std::string path = Write(name, bytes);
    return MessageOf<InputError>([&] { ReadScanFile(path, options_.point_time_unit); });
  }

  ScanSourceOptions options_;
};

// A PCD header; `fields` such as "x y z" with as many sizes and types.
inline std::string PcdHeader(const std::string& fields, const std::string& sizes,
                             const std::string& types, const std::string& width,
                             const std::string& data) {
  return "# .PCD v.7\nVERSION .7\nFIELDS " + fields + "\nSIZE " + sizes + "\nTYPE " + types +
         "\nWIDTH " + width + "\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS " + width + "\nDATA " +
         data + "\n";
}
inline std::string XyzHeader(const std::string& width, const std::string& data) {
  return PcdHeader("x y z", "4 4 4", "F F F", width, data);
}

inline std::string PlyHeader(const std::string& format, const std::string& count,
                             const std::string& more_properties = "") {
  return "ply\nformat " + format + " 1.0\ncomment a test\nelement vertex " + count +
         "\nproperty float x\nproperty float y\nproperty float z\n" + more_properties +
         "end_header\n";
}

inline std::string Replaced(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

// LZF that spells everything out: a byte with the length less one before each run of up to 32.
inline std::string Lzf(const std::string& bytes) {
  std::string packed;
  for (std::size_t i = 0; i < bytes.size(); i += 32) {
    const std::string run = bytes.substr(i, 32);
    packed += static_cast<char>(run.size() - 1) + run;
  }
  const auto size = [](const std::string& s) { return Pack(static_cast<std::uint32_t>(s.size())); };
  return size(packed) + size(bytes) + packed;
}

inline void ExpectPoint(const ScanPoint& p, float x, float y, float z, float intensity) {
  EXPECT_EQ(p.x, x);
  EXPECT_EQ(p.y, y);
  EXPECT_EQ(p.z, z);
  EXPECT_EQ(p.intensity, intensity);
}

}  // namespace lamina
