#include "io/file/file_writer.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <cerrno>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <vector>

#include "core/base/error.h"
#include "io/file/disk_room.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

std::string FolderOf(const std::string& path) {
  const fs::path folder = fs::path(path).parent_path();
  return folder.empty() ? "." : folder.string();
}

}  // namespace

void MakeDirectory(const std::string& path) {
  std::error_code error;
  std::vector<fs::path> missing;  // innermost first
  for (fs::path p = fs::path(path); !p.empty() && !fs::exists(p, error); p = p.parent_path()) {
    missing.push_back(p);
  }
  fs::create_directories(path, error);
  if (error) ThrowNotWritten(path, "the folder cannot be made", error.value());
  for (auto made = missing.rbegin(); made != missing.rend(); ++made) {
    SyncFolder(FolderOf(made->string()));
  }
}

void SyncFolder(const std::string& folder) {
  const int file = open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (file < 0) ThrowNotWritten(folder, "cannot be flushed", errno);
  const int failure = fsync(file) == 0 ? 0 : errno;
  close(file);
  // EINVAL: a file system that has no such thing, and writes names at once.
  if (failure != 0 && failure != EINVAL) ThrowNotWritten(folder, "cannot be flushed", failure);
}

void CopyFile(const std::string& from, const std::string& to) {
  std::ifstream input(from, std::ios::binary);
  if (!input) throw InputError(fmt::format("{}: cannot be opened", from));
  FileWriter writer(to);
  std::string block(1 << 20, '\0');
  do {
    input.read(block.data(), static_cast<std::streamsize>(block.size()));
    writer.Write(std::string_view(block).substr(0, static_cast<std::size_t>(input.gcount())));
  } while (input);
  if (!input.eof()) throw InputError(fmt::format("{}: cannot be read", from));
  writer.Commit();
}

FileWriter::FileWriter(std::string path)
    : path_(std::move(path)), temporary_path_(path_ + ".partial") {
  std::error_code ignored;
  const auto status = fs::status(path_, ignored);
  if (fs::exists(status) && !fs::is_regular_file(status)) {
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
  SyncFolder(FolderOf(path_));
}

void FileWriter::Fail(const char* doing) const { ThrowNotWritten(path_, doing, errno); }

}  // namespace lamina
