#include "io/file/folder_writer.h"

#include <fmt/format.h>

#include <fstream>
#include <iterator>
#include <system_error>
#include <utility>

#include "core/base/error.h"
#include "io/file/file_writer.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

void Remove(const fs::path& folder) {
  std::error_code error;
  fs::remove_all(folder, error);
  if (error) {
    throw OutputError(fmt::format("{}: cannot be removed: {}", folder.string(), error.message()));
  }
}

}  // namespace

FolderWriter::FolderWriter(fs::path target, fs::path partial)
    : target_(std::move(target)), partial_(std::move(partial)) {
  Remove(partial_);
  MakeDirectory(partial_.string());
}

FolderWriter::~FolderWriter() {
  std::error_code ignored;
  fs::remove_all(partial_, ignored);
}

void FolderWriter::Commit() {
  SyncFolder(partial_.string());
  std::error_code error;
  fs::rename(partial_, target_, error);
  if (error) {
    throw OutputError(fmt::format("{}: cannot be renamed to {}: {}", partial_.string(),
                                  target_.string(), error.message()));
  }
  SyncFolder(target_.parent_path().string());
}

void FolderWriter::Replace() {
  Remove(target_);
  Commit();
}

bool HoldsText(const fs::path& path, const std::string& text) {
  std::ifstream file(path, std::ios::binary);
  return file && std::string(std::istreambuf_iterator<char>(file), {}) == text;
}

}  // namespace lamina
