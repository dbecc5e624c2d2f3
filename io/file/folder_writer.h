// A folder of results that is whole or not there.
#pragma once

#include <filesystem>
#include <string>

namespace lamina {

// Results are made in `partial`, which then gets the name `target`. Without that, or left behind by
// a process that was killed, they are removed. Throws OutputError. Not thread-safe.
class FolderWriter {
 public:
  // Both in the same folder. What is in `partial` goes.
  FolderWriter(std::filesystem::path target, std::filesystem::path partial);
  ~FolderWriter();
  FolderWriter(const FolderWriter&) = delete;
  FolderWriter& operator=(const FolderWriter&) = delete;

  std::string path() const { return partial_.string(); }
  // There must be no target yet, or an empty one.
  void Commit();
  // A target that is there goes.
  void Replace();

 private:
  std::filesystem::path target_, partial_;
};

// Whether a file is there and holds this text and no other: such as a mark in a folder that says of
// what it was made.
bool HoldsText(const std::filesystem::path& path, const std::string& text);

}  // namespace lamina
