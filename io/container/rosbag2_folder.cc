#include "io/container/rosbag2_folder.h"

#include <algorithm>
#include <filesystem>

#include "io/container/message_container.h"
#include "io/file/folder_list.h"
#include "io/file/text_input.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

bool EndsWith(std::string_view text, std::string_view end) {
  return text.size() > end.size() && text.substr(text.size() - end.size()) == end;
}

// A plain or quoted word of YAML.
std::string Unquoted(std::string_view word) {
  const bool quoted = word.size() > 1 && (word.front() == '"' || word.front() == '\'') &&
                      word.back() == word.front();
  return std::string(quoted ? word.substr(1, word.size() - 2) : word);
}

// The list `relative_file_paths:`, a name a line behind a dash: all that is needed of the file.
std::vector<std::string> FilesInMetadata(const std::string& path) {
  const std::string text = ReadFile(path);
  LineReader lines(path, text);
  std::vector<std::string> names;
  bool in_list = false;
  while (lines.Next()) {
    const std::string_view line = lines.line();
    if (in_list && line.substr(0, 2) == "- ") {
      std::string_view name = line.substr(2);
      name.remove_prefix(std::min(name.find_first_not_of(' '), name.size()));
      names.push_back(fs::path(Unquoted(name)).filename().string());
      continue;
    }
    in_list = line == "relative_file_paths:";
  }
  return names;
}

}  // namespace

std::vector<std::string> ContainerFilesInMetadata(const std::string& path) {
  std::vector<std::string> files;
  for (const std::string& name : FilesInMetadata(path)) {
    files.push_back((fs::path(path).parent_path() / name).string());
  }
  return files;
}

bool IsContainerName(std::string_view name) {
  if (name.empty() || name.front() == '.') return false;
  for (const char* packed : {".zstd", ".zst"}) {
    if (!EndsWith(name, packed)) continue;
    name.remove_suffix(std::string_view(packed).size());
    return EndsWith(name, ".db3") || EndsWith(name, ".mcap");
  }
  return EndsWith(name, ".bag") || EndsWith(name, ".mcap") || EndsWith(name, ".db3");
}

std::vector<std::string> ContainerFilesIn(const std::string& folder) {
  const fs::path metadata = fs::path(folder) / "metadata.yaml";
  std::error_code ignored;
  std::vector<std::string> files;
  if (fs::is_regular_file(metadata, ignored)) files = ContainerFilesInMetadata(metadata.string());
  if (!files.empty()) return files;
  for (const fs::path& file : ListFiles(folder, IsContainerName)) files.push_back(file.string());
  return files;
}

}  // namespace lamina
