#include "io/file_writer.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <filesystem>
#include <stdexcept>

#include "core/error.h"

namespace lamina {

void MakeDirectory(const std::string& path) {
  std::error_code error;
  std::filesystem::create_directories(path, error);
  if (error) throw OutputError(fmt::format("cannot make the folder {}: {}", path, error.message()));
}

FileWriter::FileWriter(std::string path)
    : path_(std::move(path)), temporary_path_(path_ + ".partial") {
  std::error_code ignored;
  const auto status = std::filesystem::status(path_, ignored);
  if (std::filesystem::exists(status) && !std::filesystem::is_regular_file(status)) {
    throw OutputError(fmt::format("{}: is there already and is not a regular file", path_));
  }
  file_ = std::fopen(temporary_path_.c_str(), "wbe");
  if (file_ == nullptr) Fail("cannot be created");
  temporary_exists_ = true;
}

FileWriter::~FileWriter() {
  if (file_ != nullptr) std::fclose(file_);
  if (temporary_exists_) std::remove(temporary_path_.c_str());
}

void FileWriter::Write(std::string_view bytes) {
  if (file_ == nullptr) throw std::logic_error("FileWriter::Write after Commit: " + path_);
  if (bytes.empty()) return;  // may have no address
  if (std::fwrite(bytes.data(), 1, bytes.size(), file_) != bytes.size()) Fail("cannot be written");
}

void FileWriter::Overwrite(std::uint64_t offset, std::string_view bytes) {
  if (file_ == nullptr) throw std::logic_error("FileWriter::Overwrite after Commit: " + path_);
  if (fseeko(file_, static_cast<off_t>(offset), SEEK_SET) != 0) Fail("cannot be written");
  Write(bytes);
  if (fseeko(file_, 0, SEEK_END) != 0) Fail("cannot be written");
}

void FileWriter::Commit() {
  if (file_ == nullptr) throw std::logic_error("FileWriter::Commit called twice: " + path_);
  // Without fsync the rename may reach the disk before the bytes do.
  if (std::fflush(file_) != 0 || fsync(fileno(file_)) != 0) Fail("cannot be written");
  std::FILE* const file = file_;
  file_ = nullptr;
  if (std::fclose(file) != 0) Fail("cannot be written");
  if (std::rename(temporary_path_.c_str(), path_.c_str()) != 0) Fail("cannot be renamed to");
  temporary_exists_ = false;
}

void FileWriter::Fail(const char* doing) const {
  throw OutputError(fmt::format("{}: {}: {}", path_, doing, std::strerror(errno)));
}

}  // namespace lamina
