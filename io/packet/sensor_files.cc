#include "io/packet/sensor_files.h"

#include <fmt/format.h>

#include <cstdint>
#include <filesystem>

#include "core/base/error.h"
#include "io/file/text_input.h"

namespace lamina {
namespace {

namespace fs = std::filesystem;

}  // namespace

std::string FindBeside(const std::string& path, std::initializer_list<const char*> endings,
                       const char* name) {
  fs::path recording = path;
  if (!recording.has_filename()) recording = recording.parent_path();
  const fs::path folder = recording.parent_path();
  std::error_code ignored;
  for (const char* ending : endings) {
    const fs::path file = folder / (recording.stem().string() + ending);
    if (fs::is_regular_file(file, ignored)) return file.string();
  }
  for (const fs::path& file : {recording / name, folder / name}) {
    if (fs::is_regular_file(file, ignored)) return file.string();
  }
  return "";
}

std::string ReadSmallFile(const std::string& path) {
  constexpr std::uintmax_t kMostBytes = 4 << 20;
  std::error_code ignored;
  if (fs::file_size(path, ignored) > kMostBytes) {
    throw InputError(fmt::format("{}: has more than {} bytes", path, kMostBytes));
  }
  return ReadFile(path);
}

std::string FindOusterMetadata(const std::string& path) {
  return FindBeside(path, {".json", "_0.json"}, "metadata.json");
}

}  // namespace lamina
