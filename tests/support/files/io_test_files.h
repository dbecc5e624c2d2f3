// Files for the tests of io, made byte by byte so that no reader is checked by its own writer.
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <string_view>
#include <vector>

#include "core/base/error.h"
#include "core/geometry/scan.h"

namespace lamina {

// A fresh folder for each test, gone afterwards.
class FilesTest : public testing::Test {
 protected:
  FilesTest() {
    const auto* test = testing::UnitTest::GetInstance()->current_test_info();
    folder_ = std::filesystem::path(testing::TempDir()) /
              (std::string("lamina_") + test->test_suite_name() + "_" + test->name());
    std::filesystem::remove_all(folder_);
    std::filesystem::create_directories(folder_);
  }
  ~FilesTest() override { std::filesystem::remove_all(folder_); }

  std::string Path(const std::string& name) const { return (folder_ / name).string(); }

  std::string Write(const std::string& name, std::string_view bytes) const {
    std::filesystem::create_directories((folder_ / name).parent_path());
    std::ofstream(Path(name), std::ios::binary)
        .write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    return Path(name);
  }

  // The same in the place of a file that was there, for those that are written again and again: of
  // one that is written over, ext4 sends what is new to the disk at once, and has the writer wait.
  std::string WriteAnew(const std::string& name, std::string_view bytes) const {
    std::filesystem::remove(Path(name));
    return Write(name, bytes);
  }

  static std::string Bytes(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
  }

  std::filesystem::path folder_;
};

// Bytes that this process has handed to write calls so far.
inline std::uint64_t BytesWritten() {
  std::ifstream io("/proc/self/io");
  std::uint64_t value = 0;
  for (std::string name; io >> name >> value;) {
    if (name == "wchar:") return value;
  }
  ADD_FAILURE() << "the system does not count them";
  return 0;
}

// The bytes of the values, one after the other, without padding.
template <typename... T>
std::string Pack(T... values) {
  std::string bytes;
  const auto append = [&](const auto& value) {
    bytes.append(reinterpret_cast<const char*>(&value), sizeof(value));
  };
  (append(values), ...);
  return bytes;
}

inline std::string KittiBin(const std::vector<ScanPoint>& points) {
  return {reinterpret_cast<const char*>(points.data()), points.size() * sizeof(ScanPoint)};
}

// Runs `statement` and returns what() of the Error that it must throw.
template <typename Error, typename Statement>
std::string MessageOf(const Statement& statement) {
  try {
    statement();
  } catch (const Error& error) {
    return error.what();
  } catch (const std::exception& error) {
    ADD_FAILURE() << "threw another error: " << error.what();
    return "";
  }
  ADD_FAILURE() << "did not throw";
  return "";
}

}  // namespace lamina
